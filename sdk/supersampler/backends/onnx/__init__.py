"""The ONNX backend. No other package imports onnxruntime."""
