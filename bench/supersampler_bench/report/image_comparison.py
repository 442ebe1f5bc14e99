"""Images of several methods side by side, as one self-contained page: `supersampler.io.compare`."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

from supersampler import Upscaler
from supersampler.errors import ArgumentError
from supersampler.io.compare import About, compare_page
from supersampler.io.display import auto_exposure, display_transform, to_uint8
from supersampler.io.shot import Shot
from supersampler_bench.quality.measure import reference_size

METHODS = ("bilinear", "taa", "taau", "classifier-small", "classifier")
FRAMES = (15, 23, 31)
"""Of the shipped shot."""


def split_view(shot: Shot, methods: Sequence[str] = METHODS, frames: Sequence[int] = FRAMES) -> str:
    """Upscale a shot with each method and return the HTML of a page that compares some of its frames.

    Args:
        shot: with references.
        methods: names of shipped models.
        frames: that are shown; each has a reference.

    Raises:
        ArgumentError: one has none.
    """
    display_size = reference_size(shot)
    if not set(frames) <= set(shot.reference_indices):
        raise ArgumentError("frames", got=list(frames), want=f"some of {shot.reference_indices}")
    upscalers = {m: Upscaler(m, display_size=display_size, validate="off") for m in methods}
    about = About(title=shot.name, method="methods side by side", display_size=display_size, frame_rate=2.0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "compare.html"
        with compare_page(path, about) as page:
            for item in shot:
                images = {name: upscaler.step(item.frame) for name, upscaler in upscalers.items()}
                if item.index in frames and item.reference is not None and item.frame.color is not None:
                    exposure = item.frame.exposure or auto_exposure(item.reference)
                    truth = display_transform(item.reference, exposure)
                    shown = {name: display_transform(image, exposure) for name, image in images.items()}
                    layers = {"input": display_transform(item.frame.color, exposure), "reference": truth}
                    layers |= shown
                    page.add(item.index, {name: to_uint8(layer) for name, layer in layers.items()})
        return path.read_text(encoding="utf-8")
