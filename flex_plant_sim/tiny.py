"""The least number that is divided by or has a logarithm, so that nothing over nothing is zero."""

# Below the square of whatever an arm measures, and so far above the smallest double, 2e-308, that
# a quotient by it is finite up to 1e8.
TINY = 1e-300
