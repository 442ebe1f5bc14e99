"""`classifier` and its relatives: Guo et al. 2022, blending guided by classes.

The CPU backend (`cpu`) and its kernels; the torch definition is supersampler_model.methods.
"""
