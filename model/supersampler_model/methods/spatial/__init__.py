"""`bilinear` and `bicubic`: the baselines without history.

Nothing is learned.
"""
