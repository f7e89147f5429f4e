"""Seeded attacks on what the tools read: mutated CSV logs, bags and robot files."""
