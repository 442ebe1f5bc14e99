"""`gbuffer` and its relatives: supersampling with high-resolution G-buffers, after Wang et al. 2025.

They have no CPU kernels: ONNX Runtime runs them.
"""
