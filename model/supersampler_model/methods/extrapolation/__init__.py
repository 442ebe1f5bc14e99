"""Unshaded frames: `guided-warp`, `guided-flow` and `extrapolate`, after ExtraSS (Wu et al. 2023).

They compute a frame's colour, or supersample frames whose colour was computed so.
"""
