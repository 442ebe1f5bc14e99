"""What functions are marked with that kernels call, and Python never does."""

from numba import njit

inner = njit(no_cpython_wrapper=True, no_cfunc_wrapper=True)  # which would be a third of the time to compile
