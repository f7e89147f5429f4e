"""Hypotheses, their fits, and the search among sets of them."""
