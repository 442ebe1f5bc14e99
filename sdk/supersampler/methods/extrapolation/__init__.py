"""`guided-warp`: the colour of unshaded frames, resampled from the last shaded one (ExtraSS, Wu et al. 2023).

What it is (`spec`), its CPU backend (`cpu`) and kernels; the torch definition is supersampler_model.methods.
"""
