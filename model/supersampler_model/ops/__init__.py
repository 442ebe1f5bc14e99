"""Operations that methods share: colour, motion, sampling, rectification; the CPU kernels compute the same.

They have no weights and do not depend on a method.
"""
