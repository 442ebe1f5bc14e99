"""Kernels and device functions that several methods use, in the subset of Python that numba compiles.

`kernel_loader` compiles them; Python never calls them directly.
"""
