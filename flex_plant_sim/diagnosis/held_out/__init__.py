"""The search by held-out gains, kept until the search by evidence is better on the bank."""
