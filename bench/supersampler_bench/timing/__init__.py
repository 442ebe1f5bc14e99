"""Run time, counted work and first-frame time, on this machine, and time against quality.

Nothing here compares images; see `quality` and `agreement`.
"""
