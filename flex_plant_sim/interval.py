"""Half of an interval that holds 95 % of a normal distribution, in standard deviations."""

from statistics import NormalDist

# Half of a 95 % interval, in standard deviations of a Gaussian.
Z95 = NormalDist().inv_cdf(0.975)
