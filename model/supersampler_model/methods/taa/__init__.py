"""`taa`: Salvi 2016, variance clipping.

Nothing is learned; its CPU kernels are supersampler.methods.taa.
"""
