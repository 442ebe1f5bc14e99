"""From torch methods to model folders for the SDK: ONNX, fp16, int8, parity. Needs the `train` extra.

No operation of a method is defined here.
"""
