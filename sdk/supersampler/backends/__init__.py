"""Backends: the protocol (`base`), ONNX Runtime (`onnx/`), compiled kernels on the CPU (`cpu/`).

They are independent of the methods, which are in `methods/`.
"""
