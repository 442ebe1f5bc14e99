"""The ONNX backend: sessions, IO binding, tensors on a device.

No other modules import onnxruntime.
"""
