"""`gbuffer` and its relatives: supersampling with high-resolution G-buffers, after Wang et al. 2025.

They run in ONNX Runtime alone.
"""
