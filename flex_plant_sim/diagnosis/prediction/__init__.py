"""Prediction of a record by an arm with its effects: one step ahead, free, and smoothed."""
