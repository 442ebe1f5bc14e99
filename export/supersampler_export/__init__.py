"""Export of torch methods as model folders: ONNX, fp16, int8, parity. Needs the `train` extra."""
