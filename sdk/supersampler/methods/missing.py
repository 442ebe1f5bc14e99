"""Constants of what takes the place of missing samples (ops/missing.py of the model)."""

FILL_WINDOW = 32
"""Side of the window, samples, whose mean a missing sample gets: a multiple of the lanes of CPU kernels."""
GREY_SHARE = 1e-3
"""Weight of grey of the exposure's key beside that of a full window: it shows where the window is empty."""
FILL_CONSTANTS = {"FILL_WINDOW": FILL_WINDOW, "GREY_SHARE": GREY_SHARE}
"""FILL_WINDOW and GREY_SHARE, by the names that shaders use."""
