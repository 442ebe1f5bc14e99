"""Vectors of sixteen lanes as numba intrinsics: LLVM vector types and the instructions of each processor.

Only kernels and device functions use them.
"""
