"""What functions are marked with that kernels call, and Python never does."""

from numba import njit

# Without all this, which would be a third of the time to compile.
inner = njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, no_rewrites=True)
