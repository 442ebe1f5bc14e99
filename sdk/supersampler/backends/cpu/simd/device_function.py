"""Decorator for device functions: inlined into kernels, never called from Python."""

from numba import njit

device_function = njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, no_rewrites=True)
"""Without the wrappers and passes that only calls from Python need: a third of the compile time."""
