"""`classifier` and its relatives: Guo et al. 2022, blending guided by classes.

What it is (`spec`), its CPU backend (`cpu`) and kernels; the torch definition is supersampler_model.methods.
"""
