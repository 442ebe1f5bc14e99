"""Frame extrapolation after ExtraSS (Wu et al. 2023): `guided-warp`, `guided-flow` and `extrapolate`.

The first two compute the colour of unshaded frames; `extrapolate` upscales shaded and such frames.
"""
