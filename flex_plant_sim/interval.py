"""The probability that a stated interval holds, and the quantile of a Gaussian for it."""

from statistics import NormalDist

CREDIBLE_LEVEL = 0.95
# Half width of such an interval, in standard deviations of a Gaussian.
Z95 = NormalDist().inv_cdf(0.5 * (1.0 + CREDIBLE_LEVEL))
