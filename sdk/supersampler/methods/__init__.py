"""What a method is: its model folder and inputs; in a folder each, the stages and kernels of its CPU backend.

Torch is not imported here; the trained definition of each method is supersampler_model.methods.
"""
