"""Kernels and device functions that several methods share, in the part of Python that numba compiles.

No function here is called from Python: `kernel_loader` compiles and calls them.
"""
