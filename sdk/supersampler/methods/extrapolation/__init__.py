"""`guided-warp`: the colour of unshaded frames, resampled from the last shaded one (ExtraSS, Wu et al. 2023).

The CPU backend (`cpu`) and its kernels; the torch definition is supersampler_model.methods.
"""
