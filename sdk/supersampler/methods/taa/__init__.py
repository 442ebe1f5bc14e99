"""`taa`: Salvi 2016, variance clipping.

The CPU backend (`cpu`) and its kernels; the torch definition is supersampler_model.methods.
"""
