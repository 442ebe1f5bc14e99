"""`taau`: temporal upsampling without a network.

Its definition (`spec`), CPU backend (`cpu`) and kernels; the torch module is in supersampler_model.methods.
"""
