"""`taau`: temporal upsampling by formula alone.

Nothing is learned; its CPU kernels are supersampler.methods.taau.
"""
