"""The methods as torch modules, their training data, losses and training. Needs the `train` extra.

The torch modules define what each method computes; `supersampler_export` writes them as ONNX graphs.
"""
