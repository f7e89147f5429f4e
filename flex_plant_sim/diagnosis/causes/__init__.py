"""Hypotheses about causes, their fits, the search among sets of them and the posterior."""
