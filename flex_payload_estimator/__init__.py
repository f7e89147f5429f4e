"""Payload estimation and control of a flexible two-link arm in the delta domain."""
