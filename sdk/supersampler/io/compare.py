"""compare.html: one self-contained page that compares images, frame by frame.

>>> with compare_page("out/compare.html", about) as page:
...     for item in shot:
...         image = upscaler.step(item.frame)
...         page.add(item.index, *compare_layers(item.frame, image, item.reference, exposure))

Each frame is encoded and written to disk when it is added, so memory does not grow with the shot; the page
appears under its name when the last frame is in.
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
from typing import IO

import numpy as np

from supersampler.errors import ArgumentError
from supersampler.frame import Array, Float32, Frame, Size
from supersampler.io.atomic import replacing
from supersampler.io.display import decibels, display_transform, to_uint8
from supersampler.io.images import Bytes, encode_jpeg, encode_png
from supersampler.io.machine import installed_versions

ERROR_SCALE = 0.25
"""The error that the false colours end at, in units of the display range."""

PSNR = "PSNR (dB)"
_JPEG_QUALITY = 92
_PNG_PIXELS = 65536  # up to this many, as of a 320x180 input, PNG costs little and shows pixels as they are
_ERROR_COLORS = ((0, 0, 0), (50, 32, 112), (146, 46, 130), (226, 96, 76), (248, 176, 64), (255, 246, 190))
_FRAMES_GO_HERE = "<!-- frames -->\n"


@dataclass(frozen=True, kw_only=True)
class Legend:
    """What the false colours of a layer mean.

    Attributes:
        colors: CSS colours: a scale from `low` to `high`, evenly spaced, or one for each of `names`.
        low, high: the ends of a scale.
        names: of colours that are no scale.
    """

    colors: Sequence[str]
    low: str = ""
    high: str = ""
    names: Sequence[str] = ()


def false_color_legend(low: str, high: str) -> Legend:
    """Return the scale of `false_color`."""
    return Legend(colors=[f"rgb{color}" for color in _ERROR_COLORS], low=low, high=high)


ERROR_LEGEND = false_color_legend("0", f"{ERROR_SCALE:.0%} of the display range")


@dataclass(frozen=True, kw_only=True)
class About:
    """Captions and legends of a page.

    Attributes:
        title: the shot's name, say.
        method: what made the output.
        display_size: (width, height) at which all layers are shown, whatever their own sizes.
        frame_rate: frames a second of the page's playback.
        facts: name and value of what stands beside the title, in order.
        notes: lines of the footnote.
        legends: scales of layers in false colours, by layer.
    """

    title: str
    method: str
    display_size: Size
    frame_rate: float = 30.0
    facts: Mapping[str, str] = field(default_factory=dict)
    notes: Sequence[str] = ()
    legends: Mapping[str, Legend] = field(default_factory=lambda: {"error": ERROR_LEGEND})


class ComparePage:
    """Takes the frames of one page, in order; `compare_page` makes it."""

    def __init__(self, file: IO[str], about: About) -> None:
        self._file, self._about = file, about
        self._frames: list[dict[str, object]] = []
        self._layers: dict[str, None] = {}  # these two are ordered sets
        self._numbers: dict[str, None] = {}

    def add(
        self, index: int, layers: Mapping[str, Bytes], numbers: Mapping[str, float] | None = None
    ) -> None:
        """Encode and write one frame.

        Args:
            index: its place in the shot; larger than the one before.
            layers: name to (h, w, 3) uint8 sRGB image of any size, shown stretched to the display size.
                A frame may lack layers that others have.
            numbers: name to value, of this frame; the page shows them and their mean.

        Raises:
            ArgumentError: the index is not larger than the last.
        """
        last = self._frames[-1]["index"] if self._frames else -1
        if index <= int(str(last)):
            raise ArgumentError("index", got=index, want=f"frames in order, more than {last}")
        for name, pixels in layers.items():
            tag = f'<script type="text/plain" id="{index}/{escape(name)}">'
            self._file.write(f"{tag}{_data_uri(pixels)}</script>\n")
        numbers = {name: value for name, value in (numbers or {}).items() if np.isfinite(value)}
        self._frames.append({"index": index, "layers": list(layers), "numbers": numbers})
        self._layers.update(dict.fromkeys(layers))
        self._numbers.update(dict.fromkeys(numbers))

    def write_summary(self) -> None:
        """Write the captions of all frames; no frame may follow.

        Raises:
            ArgumentError: there is no frame.
        """
        if not self._frames:
            raise ArgumentError("frames", got="none", want="at least one to compare")
        content = {
            **asdict(self._about),
            "facts": list(self._about.facts.items()),
            "layers": list(self._layers),
            "numbers": list(self._numbers),
            "frames": self._frames,
        }
        text = json.dumps(content, ensure_ascii=False).replace("<", "\\u003c")  # no tag ends the script early
        self._file.write(f'<script type="application/json" id="page">{text}</script>\n')


@contextmanager
def compare_page(path: Path | str, about: About) -> Iterator[ComparePage]:
    """Write a page: the file appears when the block ends well, and not at all where it does not.

    Args:
        path: the file; one that is there stays until the new one is complete.
        about: title, sizes, notes.

    Raises:
        ShotError: the file cannot be written.
        ArgumentError: the block has added no frame.
    """
    head, tail = files("supersampler").joinpath("compare.html").read_text("utf-8").split(_FRAMES_GO_HERE)
    with replacing(path) as partial, partial.open("w", encoding="utf-8", newline="\n") as file:
        file.write(head)
        page = ComparePage(file, about)
        yield page
        page.write_summary()
        file.write(tail)


def compare_layers(
    frame: Frame, image: Float32, reference: Float32 | None, exposure: float
) -> tuple[dict[str, Bytes], dict[str, float]]:
    """Return the usual layers and numbers of one frame, for `ComparePage.add`.

    Args:
        frame: what was upscaled; without colour there is no layer `input`.
        image: (H, W, 3) linear RGB, the output.
        reference: linear RGB; one of another size than the image is shown, but not compared. Or None.
        exposure: > 0, for all images of the frame.

    Returns:
        The layers input, output, reference, error as uint8 sRGB, and the PSNR over the whole frame; the last
        two only where there is a reference of the image's size.
    """
    shown = display_transform(image, exposure)
    layers = {} if frame.color is None else {"input": to_uint8(display_transform(frame.color, exposure))}
    layers["output"] = to_uint8(shown)
    if reference is None:
        return layers, {}
    truth = display_transform(reference, exposure)
    layers["reference"] = to_uint8(truth)
    if truth.shape != shown.shape:
        return layers, {}
    layers["error"] = false_color(np.abs(shown - truth).mean(axis=-1) / ERROR_SCALE)
    mean_squared = float(np.square(shown - truth, dtype=np.float64).mean())
    return layers, {PSNR: decibels(mean_squared)}


def false_color(values: Array) -> Bytes:
    """Map (h, w) values in [0, 1] to (h, w, 3) uint8: black, violet, red, orange, pale yellow.

    Lightness rises evenly with the value, so that the image also reads in grey; values outside are clamped.
    """
    stops = np.linspace(0.0, 1.0, len(_ERROR_COLORS))
    channels = [np.interp(values, stops, channel) for channel in zip(*_ERROR_COLORS, strict=True)]
    return to_uint8(np.stack(channels, axis=-1) / 255.0)


def versions() -> str:
    """Return one line with the versions that made a page, as far as they are installed."""
    names = ("supersampler", "onnxruntime", "onnxruntime-gpu", "onnxruntime-directml", "numpy")
    installed = [f"{name} {version}" for name, version in installed_versions(*names).items()]
    return ", ".join([*installed, f"Python {platform.python_version()}", platform.platform(terse=True)])


def _data_uri(pixels: Bytes) -> str:
    small = pixels.shape[0] * pixels.shape[1] <= _PNG_PIXELS
    data = encode_png(pixels) if small else encode_jpeg(pixels, _JPEG_QUALITY)
    return f"data:image/{'png' if small else 'jpeg'};base64,{base64.b64encode(data).decode('ascii')}"
