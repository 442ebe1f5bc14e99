"""From torch methods to model folders for the SDK: ONNX, fp16, int8, parity. Needs the `train` extra.

The methods themselves are in `supersampler_model.methods`.
"""
