"""The flexible two-link arm: its models, its effects, its simulator and the diagnosis of logs."""
