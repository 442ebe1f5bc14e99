"""Stress: long runs and hostile frames, whose figures have bounds. `runner` runs families of scenarios."""
