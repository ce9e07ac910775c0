"""The IMM-JPDA filter of Heymann et al., as printed."""
