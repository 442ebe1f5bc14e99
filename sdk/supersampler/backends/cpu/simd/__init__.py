"""SIMD vectors for kernels, as numba intrinsics on LLVM's vector types.

Kernels and device functions use them; Python never calls them.
"""
