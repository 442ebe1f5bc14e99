"""`bilinear` and `bicubic`: the baselines without history.

They have no network.
"""
