"""The step that blends a frame's AOVs, which every model folder has as `aovs.onnx`.

Its definition (`spec`); no kernels. The torch definition is supersampler_model.methods.aovs.
"""
