"""Memory layout of the arrays that kernels share with Python."""

from supersampler.methods.at_rest import TILE as TILE

LANES = 16
"""Lanes of a vector. Rows of pixels are padded to a multiple of it."""
PAD = 16
"""Columns of padding before and after each row of samples, so that neighbourhoods need no bounds checks."""

SAMPLE_PLANES = 10
"""Planes of a row of samples: toned RGB, 1 where usable, YCoCg, squares of YCoCg."""
FILTER_LINES = 16
"""Lines of filtered samples: RGB and usable by the first filter; the same by the second; YCoCg, its squares
and usable by the third; in `taau`, luma by a filter of its own."""

TAA_PIXEL = 3
"""Values of a history pixel: linear RGB."""
TAA_PLANES = 6
"""Planes of a row of samples: YCoCg, motion, 1 where usable."""
TAA_BOX = 8
"""Planes of a row of colour boxes: low corner, high corner, longest motion."""

TAAU_PIXEL = 5
"""Values of a history pixel: linear RGB, samples, power."""

GUIDE_PLANES, SHADED_PLANES = 7, 10
"""Planes of a shaded frame: guides, by which surfaces are compared; guides and light."""

CLASSIFIER_PIXEL = 8
"""Values of a history pixel: linear RGB, count, luma range, two unused."""
INPUT_PLANES = 16
"""Network inputs of a pixel, one byte each: see methods.classifier.kernels.network_inputs."""
RECORD_WORDS = 18
"""Words of a packed pixel (2x2 display pixels): INPUT_PLANES, then two of inputs at half display size."""
PIXELS_AT_ONCE = 6
"""Pixels whose sums of products a layer of the network computes together, in registers."""
SURFACE_PLANES = 9
"""Planes of a row of samples with G-buffers: light, toned; normal and base colour, scaled."""
HISTORY_PLANES = 3
"""float32 planes of the warped history between gather and finish: RGB. Rounding to fp16 would accumulate."""
