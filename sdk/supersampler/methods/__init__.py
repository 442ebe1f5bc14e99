"""Methods: the registry, model folders, and in a folder each a method's `spec`, kernels and shaders.

Torch is not imported here; the trained definition of each method is supersampler_model.methods.
"""
