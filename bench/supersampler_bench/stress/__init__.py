"""Stress: long runs and hostile frames, each measured against a bound that follows from a promise.

Scenarios in families; `runner` runs them and shows the outcomes.
"""
