"""The layout of the rows of models that `sided_imm` takes; apart from it, so that settings need no compiler."""

STRAIGHT, TURNING, SPEEDING = 0, 1, 2
KIND, NOISE, OWN, OWN_SIGMA, OWN_NOISE, SHARE = range(6)
