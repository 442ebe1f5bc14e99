"""`taau`: temporal upsampling by formula alone.

What it is (`spec`), its CPU backend (`cpu`) and kernels; the torch definition is supersampler_model.methods.
"""
