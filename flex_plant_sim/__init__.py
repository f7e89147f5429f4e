"""The flexible two-link arm: its models, its simulator, its effects and their diagnosis."""
