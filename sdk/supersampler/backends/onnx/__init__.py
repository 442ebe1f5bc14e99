"""The ONNX backend: sessions, IO binding, tensors on a device, CUDA graphs.

The only modules that import onnxruntime; nothing here reads the pixels of a frame.
"""
