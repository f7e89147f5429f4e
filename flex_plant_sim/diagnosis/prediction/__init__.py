"""One-step and free-running prediction of a record by an arm with its effects."""
