"""`taa`: Salvi 2016, variance clipping.

What it is (`spec`), its CPU backend (`cpu`) and kernels; the torch definition is supersampler_model.methods.
"""
