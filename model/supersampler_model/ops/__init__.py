"""Operations that methods share: colour, motion, sampling, rectification; the CPU kernels compute the same.

Nothing here has weights or knows a method.
"""
