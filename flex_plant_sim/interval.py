"""Half of an interval that holds 95 % of a normal distribution, in standard deviations."""

from statistics import NormalDist

Z95 = NormalDist().inv_cdf(0.975)
