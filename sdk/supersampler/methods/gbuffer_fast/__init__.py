"""`gbuffer-fast`: `classifier` on light that G-buffers of display size guide.

Its definition (`spec`) and its CPU backend (`cpu`), of the classifier's kernels. The torch definition is
supersampler_model.methods.gbuffer_fast.
"""
