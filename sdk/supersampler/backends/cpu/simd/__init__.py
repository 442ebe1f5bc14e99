"""SIMD vectors for kernels, as numba intrinsics on LLVM's vector types."""
