"""`classifier-large`: `classifier` with a history of 1.4 times the display's width and height.

Its definition (`spec`) and its CPU backend (`cpu`): that of `classifier`, and a filter (`downsampling`,
`kernels`).
The torch definition is supersampler_model.methods.classifier_large.
"""
