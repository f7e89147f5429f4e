"""The quantile of the normal distribution for two-sided 95 % intervals."""

from statistics import NormalDist

# Half width of a 95 % interval, in standard deviations of a Gaussian.
Z95 = NormalDist().inv_cdf(0.975)
