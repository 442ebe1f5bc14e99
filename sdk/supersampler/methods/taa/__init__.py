"""`taa`: Salvi 2016, variance clipping.

Its definition (`spec`), CPU backend (`cpu`) and kernels; the torch twin is in supersampler_model.methods.
"""
