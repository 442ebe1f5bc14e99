"""`classifier` and its relatives: Guo et al. 2022, blending guided by classes.

Its definition (`spec`), its CPU backend (`cpu`) and kernels; the torch definition is supersampler_model.methods.
"""
