"""`taa`: Salvi 2016, variance clipping.

It has no network; its CPU kernels are in `supersampler.methods.taa`.
"""
