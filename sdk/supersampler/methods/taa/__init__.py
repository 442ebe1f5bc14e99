"""`taa`: temporal anti-aliasing with variance clipping (Salvi 2016).

Its definition (`spec`), CPU backend (`cpu`) and kernels; the torch module is in supersampler_model.methods.
"""
