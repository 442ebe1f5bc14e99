"""`gbuffer` and its relatives: supersampling with G-buffers of display size.

Their definitions (`spec`); no kernels yet. The torch definition is supersampler_model.methods.gbuffer.
"""
