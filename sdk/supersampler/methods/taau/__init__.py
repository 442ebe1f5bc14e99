"""`taau`: temporal upsampling by formula alone.

The CPU backend (`cpu`) and its kernels; the torch definition is supersampler_model.methods.
"""
