"""Header entries of upscaled images: those of the frames, fitted to size and frame rate of the images."""

from supersampler.frame import Size
from supersampler.io.image_headers import FRAME_RATE, PIXEL_ASPECT, Metadata, TypedValues, rate_of
from supersampler.io.video import exact_rate

_TIME_CODE = "smpte:TimeCode"  # it counts frames of a second
_ROUNDED = 0.02  # relative difference of the two axes' ratios that rounding to whole pixels explains


def result_metadata(
    metadata: Metadata, *, frame_rate: float | None, render_size: Size, display_size: Size
) -> Metadata:
    """Return the entries of an image's header.

    The pixel aspect ratio changes where the two axes are enlarged by different ratios. The frame rate, where
    the header states one, becomes that of the film; a time code of another rate is left out.

    Args:
        metadata: of the frame, see `read_exr_metadata`.
        frame_rate: of the film; None keeps the header's.
        render_size: (width, height) of the frame.
        display_size: (width, height) of the image.
    """
    entries = dict(metadata)
    across, down = display_size[0] / render_size[0], display_size[1] / render_size[1]
    if abs(across / down - 1.0) > _ROUNDED:
        entries[PIXEL_ASPECT] = pixel_aspect(metadata) * down / across
    stated = rate_of(metadata.get(FRAME_RATE))
    if stated is not None and frame_rate is not None and exact_rate(frame_rate) != exact_rate(stated):
        rate = exact_rate(frame_rate)
        entries[FRAME_RATE] = TypedValues("rational", (rate.numerator, rate.denominator))
        entries.pop(_TIME_CODE, None)
    return entries


def pixel_aspect(metadata: Metadata) -> float:
    """Return the width of a pixel over its height, 1 where a header states none."""
    value = metadata.get(PIXEL_ASPECT)
    return float(value) if isinstance(value, int | float) and 0.01 <= value <= 100.0 else 1.0
