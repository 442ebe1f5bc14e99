"""Kernels of `classifier`: gather, the features its network reads, the last layers and the blend.

Shared device functions are in `backends.cpu.kernels`.
"""
