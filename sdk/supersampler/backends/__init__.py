"""How a step runs: the protocol (`base`), ONNX Runtime (`onnx/`), compiled kernels on the CPU (`cpu/`).

What a method computes lives in `methods/`; no module here knows one method from another.
"""
