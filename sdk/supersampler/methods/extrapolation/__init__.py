"""`guided-warp`: the colour of unshaded frames, resampled from the last shaded one (ExtraSS, Wu et al. 2023).

Its definition (`spec`), CPU backend (`cpu`) and kernels; the torch module is in supersampler_model.methods.
"""
