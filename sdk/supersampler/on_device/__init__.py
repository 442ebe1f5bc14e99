"""Calls of a `Model` and an `Upscaler` that take and return images in memory of a device.

Tensors of ONNX Runtime, and textures and buffers of wgpu.
"""
