"""From the posterior over sets of causes to a verdict, detection limits and advice."""
