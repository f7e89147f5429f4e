"""
Diagnosis of a simulation from records: what is wrong, why, and what mending it gains.

The packages stand in the order of the data: record, prediction, likelihood, causes, verdict and
report. `verdict.verdict.diagnose` is the entry, and `verdict.completion.complete` after it.
"""
