"""Step time, first-frame time and counted work of methods, and time against quality.

Nothing here compares images; see `quality` and `agreement`.
"""
