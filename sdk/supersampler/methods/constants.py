"""Constants that all methods share. Torch modules, CPU kernels and shaders read them from here.

Constants of one method are in its `spec.py`, those of static content in `at_rest.py`, and those of exposure
and tone curve in `io.display`.
"""

MAX_TONED = 1.0 - 1e-4
"""Maximum of a toned colour; 1 is infinite light."""
DARKNESS = 1e-12
"""Light below which an image is black: fading averages would otherwise end as denormals, which are slow."""
GLARE_EXPOSED = 1024.0
"""Exposed light ten stops over white; no display can distinguish brighter light."""
GLARE_TONED = GLARE_EXPOSED / (1.0 + GLARE_EXPOSED)
"""GLARE_EXPOSED after the tone curve."""
GLARE = 4.0
"""Added to a history value in [0, 1] for each consecutive frame with such light nearby."""
CONFIRMED = 3.0
"""Consecutive frames after which such light is accumulated: one shaded, one extrapolated, one more."""

MIN_WEIGHT = 1e-3
"""Sum of weights below which no sample of a neighbourhood is usable."""
MIN_CUBIC_WEIGHT = 0.9
"""Sum of weights from which a cubic is used: with missing samples its negative weights dominate."""
FULL_WEIGHT = 0.999
"""Sum of weights from which on all samples of a neighbourhood are usable."""
MIN_KERNEL_WEIGHT = 1e-4
"""Added to the Gaussian that a learned kernel multiplies: no sample around is out of its reach."""

ROUND, ACROSS, ALONG = 0.465, 0.66, 0.26
"""Reciprocals of the squared distance, render pixels, at which a sample has no weight when one frame is
upsampled along its edges: without an edge, across one, and along it, where it is at least 1/4. Fitted to
single frames of training sequences, then made 4 % narrower, as samples of later frames are added."""
EDGE_CONTRAST = 5e-4
"""Squared gradient of toned luma per render pixel from which on there is an edge rather than noise."""

FINITE_MOTION = 3e38
"""Render pixels: longer motion counts as none, as NaN does."""
MAX_MOTION = 1e6
"""Render pixels along an axis, to which motion is clamped."""
MAX_DEPTH = 1e30
"""Largest depth; larger depth is unknown."""
UNKNOWN_DEPTH = -1.0
"""Depth of a sample whose depth is not usable: below the sky's 0, so never the closest or disoccluded."""
THIN_MOTION = 0.5
"""Motion relative to the background, render pixels a frame along an axis, from which a thin surface counts as
leaving its place."""
SAME_THIN_DEPTH = 0.95
"""Minimum depth of another part of thin geometry, as a fraction of its depth."""
MIN_NORMAL = 0.1
"""Squared length of a normal below which the surface is the sky, which has none."""
CATMULL_ROM = 0.5
"""Sharpness at which a cubic is that of Catmull and Rom: minus its slope at distance 1."""

FILL_WINDOW = 32
"""Side of the window, samples, whose mean replaces missing ones: a multiple of the lanes of CPU kernels."""
GREY_SHARE = 1e-3
"""Weight of mid-grey (the exposure's key) relative to that of a full window: it fills empty windows."""
