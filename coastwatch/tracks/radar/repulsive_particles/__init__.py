"""The repulsive multi particle filter of Heymann et al., repaired: tracks from radar video without plots."""
