"""Payload estimators behind one interface."""
