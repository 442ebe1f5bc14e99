"""How arrays lie in memory: what kernels and those who call them both go by. Imports nothing."""

LANES = 16
"""Values of a vector; rows of pixels end in whole vectors."""
PAD = 16
"""Columns before and after a plane, that neighbourhoods reach into."""
TILE = 32
"""Display pixels of a tile's side: what a step does or leaves undone."""
SAMPLES = 16
"""Samples of a side of the tiles that a frame is compared in with what it was."""

SAMPLED = 10
"""Planes of a row of samples: red, green, blue, usable; YCoCg and its squares."""
FILTERED = 16
"""Lines that filters make of them: four of the first, four of a second; YCoCg, its squares and usable of a
third; one of none."""

TAA_PIXEL = 3
"""Values of a pixel that go from frame to frame: linear RGB."""
TAA_PLANES = 5
"""Of a row: YCoCg, motion."""
TAA_BOX = 8
"""Planes of a row: low and high corner, longest motion."""

TAAU_PIXEL = 5
"""Values of a pixel that go from frame to frame: linear RGB, count, power."""

GUIDE, GUIDED = 7, 10
"""Planes of a shaded frame's samples: what their surfaces are told from; and these with the light on them."""

CLASSIFIER_PIXEL = 8
"""Values of a pixel that go from frame to frame: linear RGB, count, range, and two of room."""
SEEN = 16
"""Bytes that the network sees of a pixel: see methods.classifier.kernels.network_inputs."""
RECORD = 18
"""Words of four packed pixels: SEEN, and two at half size."""
PAST = 3
"""Floats of a pixel from gather to finish: the colour that goes around, where rounding would add up."""
