"""`bilinear` and `bicubic`: each frame by itself.

What they are (`spec`); no kernels. The torch definition is supersampler_model.methods.spatial.
"""
