"""The ONNX backend: sessions, IO binding, tensors on a device, CUDA graphs.

No other modules import onnxruntime.
"""
