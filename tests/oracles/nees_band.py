"""The band of a mean NEES by the chi-square distribution, from scipy."""

from scipy.special import gammainccinv, gammaincinv


def band(count: int, dimension: int, level: float) -> tuple[float, float]:
    """Interval that the mean of independent NEES leaves with this probability, half on each side.

    Args: count: of values averaged; dimension: d of each; level: e.g. 1e-6.
    """
    shape = 0.5 * count * dimension
    low, high = (2.0 / count * float(inverse(shape, 0.5 * level)) for inverse in (gammaincinv, gammainccinv))
    return low, high
