"""What a method is: its model folder; in a folder each, its `spec`, and its stages and kernels on the CPU.

Torch is not imported here; the trained definition of each method is supersampler_model.methods.
"""
