"""Write compare.html: a self-contained page that compares images, frame by frame.

>>> with compare_page("out/compare.html", about) as page:
...     for item in shot:
...         image = upscaler.step(item.frame)
...         page.add(item.index, *compare_layers(item.frame, image, item.reference, exposure))

Each frame is encoded and written when it is added, so memory does not grow with the shot. The file appears
when the block ends.
"""

import base64
import json
import platform
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import IO, Any

import numpy as np

from supersampler.errors import ArgumentError
from supersampler.frame import Array, Float32, Frame, Size
from supersampler.io.display import decibels, missing_pixels, to_uint8
from supersampler.io.display_transforms import DEFAULT_TRANSFORM, DisplayTransform
from supersampler.io.files import replacing
from supersampler.io.images import Bytes, encode_jpeg, encode_png
from supersampler.io.machine import versions

ERROR_SCALE = 0.25
"""Largest error of the false-colour scale, as a fraction of the display range."""

PSNR = "PSNR (dB)"
MEANINGS: Mapping[str, str] = {
    "input": "The frame as rendered, jittered, at render size.",
    "bicubic": "This frame alone, its jitter removed, enlarged by Catmull-Rom interpolation.",
    "output": "The method's output, from this frame and the previous frames.",
    "reference": "The reference, rendered at display size with many samples per pixel.",
    "error": "Mean over r, g and b of the absolute difference between output and reference.",
    "classes": "Class of each pixel: disocclusion, shading change, aliasing, or none of these.",
    "weight": "Weight of the history in each output pixel, in [0, 1].",
    "count": "Number of samples that each pixel of the history has accumulated.",
    "converged": "Pixels whose output is frozen at the mean of their samples, because the scene is static.",
    PSNR: "Peak signal-to-noise ratio of output and reference as displayed; higher is better.",
    "method": "Name of the method that made the output.",
    "size": "Width and height of the input, and of the output.",
    "runs on": "ONNX Runtime provider, backend and precision of the network.",
    "frames": "Number of frames in the shot; the page has the last ones.",
}
"""Tooltips of the layers, numbers and facts."""

_JPEG_QUALITY = 92
_PNG_PIXELS = 65536  # smaller images are PNG, which costs little and is exact
_ERROR_COLORS = ((0, 0, 0), (50, 32, 112), (146, 46, 130), (226, 96, 76), (248, 176, 64), (255, 246, 190))
_FRAMES_GO_HERE = "<!-- frames -->\n"


@dataclass(frozen=True, kw_only=True)
class Legend:
    """Legend of a layer in false colours.

    Attributes:
        colors: CSS colours: an even scale from `low` to `high`, or one per name of `names`.
        low, high: labels of the ends of a scale.
        names: labels of separate colours.
    """

    colors: Sequence[str]
    low: str = ""
    high: str = ""
    names: Sequence[str] = ()


def false_color_legend(low: str, high: str) -> Legend:
    """Return the legend of `false_color` with these labels at its ends."""
    return Legend(colors=[f"rgb{color}" for color in _ERROR_COLORS], low=low, high=high)


ERROR_LEGEND = false_color_legend("0", f"{ERROR_SCALE:.0%} of the display range")


@dataclass(frozen=True, kw_only=True)
class About:
    """Captions and legends of a page.

    Attributes:
        title: for example the shot's name.
        method: name of the method that made the output.
        display_size: (width, height) at which layers of all sizes are shown.
        frame_rate: playback rate, frames a second.
        facts: names and values shown beside the title, in order.
        notes: lines of the footnote.
        legends: legends of layers in false colours, by layer.
    """

    title: str
    method: str
    display_size: Size
    frame_rate: float = 30.0
    facts: Mapping[str, str] = field(default_factory=dict)
    notes: Sequence[str] = ()
    legends: Mapping[str, Legend] = field(default_factory=lambda: {"error": ERROR_LEGEND})


class ComparePage:
    """Writer of one page's frames, in order; `compare_page` makes it."""

    def __init__(self, file: IO[str], about: About) -> None:
        self._file, self._about = file, about
        self._frames: list[dict[str, Any]] = []

    def add(
        self, number: int, layers: Mapping[str, Bytes], numbers: Mapping[str, float] | None = None
    ) -> None:
        """Encode and write one frame.

        Args:
            number: the frame's number in the shot; larger than the previous one.
            layers: name to (h, w, 3) uint8 sRGB image of any size, shown stretched to the display size.
                Frames may have different layers.
            numbers: name to value; the page shows each frame's values, and their means.

        Raises:
            ArgumentError: the number is not larger than the previous one.
        """
        if self._frames and number <= (last := self._frames[-1]["number"]):
            raise ArgumentError("number", got=number, want=f"frames in order, more than {last}")
        for name, pixels in layers.items():
            small = pixels.shape[0] * pixels.shape[1] <= _PNG_PIXELS
            data = encode_png(pixels) if small else encode_jpeg(pixels, _JPEG_QUALITY)
            uri = f"data:image/{'png' if small else 'jpeg'};base64,{base64.b64encode(data).decode('ascii')}"
            self._file.write(f'<script type="text/plain" id="{number}/{escape(name)}">{uri}</script>\n')
        numbers = {name: value for name, value in (numbers or {}).items() if np.isfinite(value)}
        self._frames.append({"number": number, "layers": list(layers), "numbers": numbers})

    def finish(self) -> None:
        """Write the captions of all frames; ArgumentError if there is no frame."""
        if not self._frames:
            raise ArgumentError("frames", got="none", want="at least one to compare")
        content = {
            **asdict(self._about),
            "meanings": MEANINGS,
            "facts": list(self._about.facts.items()),
            **{key: self._names(key) for key in ("layers", "numbers")},
            "frames": self._frames,
        }
        text = json.dumps(content, ensure_ascii=False).replace("<", "\\u003c")  # a tag would end the script
        self._file.write(f'<script type="application/json" id="page">{text}</script>\n')

    def _names(self, key: str) -> list[str]:
        """Return the distinct names of all frames, in the order of their first appearance."""
        return list(dict.fromkeys(name for frame in self._frames for name in frame[key]))


@contextmanager
def compare_page(path: Path | str, about: About) -> Iterator[ComparePage]:
    """Write a page. The file appears when the block ends without an error; until then an older one stays.

    Raises:
        ShotError: the file cannot be written.
        ArgumentError: the block has added no frame.
    """
    head, tail = files("supersampler").joinpath("compare.html").read_text("utf-8").split(_FRAMES_GO_HERE)
    with (
        replacing(path) as partial,
        partial.open("w", encoding="utf-8", errors="surrogateescape", newline="\n") as file,
    ):
        file.write(head)
        page = ComparePage(file, about)
        yield page
        page.finish()
        file.write(tail)


def compare_layers(
    frame: Frame,
    image: Float32,
    reference: Float32 | None,
    exposure: float,
    *,
    bicubic: Float32 | None = None,
    transform: DisplayTransform = DEFAULT_TRANSFORM,
) -> tuple[dict[str, Bytes], dict[str, float]]:
    """Return the layers and numbers of one frame, for `ComparePage.add`.

    Args:
        frame: the input frame; an unshaded frame has no layer `input`.
        image: (H, W, 3) linear RGB, the output.
        reference: linear RGB, or None. A reference of another size is shown, but not compared.
        exposure: > 0, for all images of the frame.
        bicubic: (H, W, 3) linear RGB, the output of the method `bicubic`; None omits the layer.
        transform: display transform of all images.

    Returns:
        The layers input, bicubic, output, reference, error as uint8, and the PSNR over the whole frame. Error
        and PSNR need a reference of the image's size, and leave out its pixels with NaN.
    """
    shown = transform.show(image, exposure)
    before = {"input": frame.color, "bicubic": bicubic}
    layers = {
        name: to_uint8(transform.show(each, exposure)) for name, each in before.items() if each is not None
    }
    layers["output"] = to_uint8(shown)
    if reference is None:
        return layers, {}
    truth = transform.show(reference, exposure)
    layers["reference"] = to_uint8(truth)
    if truth.shape != shown.shape:
        return layers, {}
    known = ~missing_pixels(reference)
    error = shown - truth
    error[~known] = 0.0
    layers["error"] = false_color(np.abs(error).mean(axis=-1) / ERROR_SCALE)
    if not known.any():
        return layers, {}
    compared = error if known.all() else error[known]
    return layers, {PSNR: decibels(float(np.square(compared, dtype=np.float64).mean()))}


def false_color(values: Array) -> Bytes:
    """Map (h, w) values in [0, 1] to (h, w, 3) uint8: black, violet, red, orange, pale yellow.

    Lightness rises evenly with the value. Values outside are clamped.
    """
    stops = np.linspace(0.0, 1.0, len(_ERROR_COLORS))
    channels = [np.interp(values, stops, channel) for channel in zip(*_ERROR_COLORS, strict=True)]
    return to_uint8(np.stack(channels, axis=-1) / 255.0)


def versions_text() -> str:
    """Return one line with the versions of the installed packages that images depend on."""
    installed = [f"{name} {version}" for name, version in versions().items()]
    return ", ".join([*installed, platform.platform(terse=True)])
