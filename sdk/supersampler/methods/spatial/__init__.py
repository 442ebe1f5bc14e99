"""`bilinear` and `bicubic`: each frame by itself.

Their definitions (`spec`); no kernels. The torch definition is supersampler_model.methods.spatial.
"""
