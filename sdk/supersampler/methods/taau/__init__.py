"""`taau`: temporal upsampling by formula alone.

Its definition (`spec`), CPU backend (`cpu`) and kernels; the torch twin is in supersampler_model.methods.
"""
