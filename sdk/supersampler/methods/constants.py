"""Constants that methods share. Torch modules, CPU kernels and shaders take them from here.

Constants of one method are in its `spec.py`, of static content in `at_rest.py`, and of exposure and tone
curve in `io.display`.
"""

MAX_TONED = 1.0 - 1e-4
"""Maximum of a toned colour; 1 is infinite light."""
HIGHLIGHT_TONED = 0.75
"""Toned colour, three times white, above which a filtered colour may not exceed the samples around it. There,
the inverse of the tone curve turns a small overshoot into a multiple of the light."""
DARKNESS = 1e-12
"""Light below which an image is black; decaying averages would otherwise end as denormals, which are slow."""
GLARE_EXPOSED = 1024.0
"""Exposed light ten stops over white; no display shows a difference above it."""
GLARE_TONED = GLARE_EXPOSED / (1.0 + GLARE_EXPOSED)
"""GLARE_EXPOSED after the tone curve."""
GLARE = 4.0
"""Added to a history value in [0, 1] for each consecutive frame with such light nearby."""
CONFIRMED = 3.0
"""Consecutive frames after which such light is accumulated: one shaded, one extrapolated, one more."""

MIN_WEIGHT = 1e-3
"""Sum of weights below which no sample of a neighbourhood is usable."""
MIN_CUBIC_WEIGHT = 0.9
"""Sum of weights from which on a cubic is used: with missing samples its negative weights dominate."""
FULL_WEIGHT = 0.999
"""Sum of weights from which on all samples of a neighbourhood are usable."""
MIN_KERNEL_WEIGHT = 1e-4
"""Added to the Gaussian that a learned kernel multiplies, so that the kernel reaches every sample."""

ROUND, ACROSS, ALONG = 0.465, 0.66, 0.26
"""Reciprocals of the squared distance, render pixels, at which the weight of a sample is 0 when one frame is
upsampled along its edges: without an edge, across an edge, and along it (at least 1/4 there). Fitted to
single frames of training sequences, then made 4 % narrower, because later frames add samples."""
EDGE_CONTRAST = 5e-4
"""Squared gradient of toned luma per render pixel above which there is an edge rather than noise."""

FINITE_MOTION = 3e38
"""Motion in render pixels above which it counts as none, as NaN does."""
MAX_MOTION = 1e6
"""Limit of motion along an axis, render pixels."""
MAX_DEPTH = 1e30
"""Largest valid depth; larger values are unknown depth."""
UNKNOWN_DEPTH = -1.0
"""Depth of a sample without a valid depth: below the sky's 0, so never the closest or disoccluded."""
THIN_MOTION = 0.5
"""Motion relative to the background, render pixels per frame along an axis, from which on a thin surface
disoccludes its previous position."""
SAME_THIN_DEPTH = 0.95
"""Minimum depth of another part of thin geometry, as a fraction of its depth."""
MIN_NORMAL = 0.1
"""Squared length of a normal below which there is no surface (sky)."""
CATMULL_ROM = 0.5
"""Sharpness of the Catmull-Rom cubic: minus its slope at distance 1."""

FILL_WINDOW = 32
"""Side of the window, samples, whose mean replaces missing samples; a multiple of the CPU kernels' lanes."""
GREY_SHARE = 1e-3
"""Weight of mid-grey (the exposure's key) relative to a full window; it fills empty windows."""
