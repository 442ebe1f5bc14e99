"""Blending of AOVs, a graph `aovs.onnx` in every model folder of an upscaler."""
