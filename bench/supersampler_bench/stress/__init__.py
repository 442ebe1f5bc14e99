"""Stress tests: long runs and hostile frames. `runner` runs scenarios and compares figures with bounds."""
