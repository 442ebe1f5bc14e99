"""`classifier` and its relatives: Guo et al. 2022, blending guided by classes.

Definitions (`spec`), CPU backend (`cpu`) and kernels; torch: supersampler_model.methods.classifier.
"""
