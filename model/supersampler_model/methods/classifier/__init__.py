"""`classifier` and `classifier-small`: blending guided by classes, after Guo et al. 2022.

Their CPU kernels are supersampler.methods.classifier.
"""
