"""Record of `make three`: ways to upscale what three.js draws, in a browser, with their errors."""

from collections.abc import Mapping
from dataclasses import dataclass

from supersampler.cli.arguments import size_text
from supersampler.frame import Size
from supersampler_bench.record import BenchRecord, figure, table

NATIVE = "three-traa"
"""The method that renders at display size."""
TITLES: Mapping[str, str] = {
    "bilinear": "bilinear",
    "three-taau": "three.js `TAAUNode`",
    "three-taau-sharp": "the same, textures as sharp as at full size",
    NATIVE: "three.js `TRAANode`, rendered at full size",
}
"""Titles of the methods that are not of this package."""


@dataclass(frozen=True)
class ThreeScores:
    """Errors of one method, dB, of display values."""

    method: str  # one of TITLES, or a method of this package
    psnr: float  # mean over the frames after the first eight
    tpsnr: float  # PSNR of the changes between these frames
    first: float  # PSNR of the first image, which has no history


@dataclass(frozen=True)
class ThreeRecord(BenchRecord):
    """Errors of methods in one scene."""

    three: str  # version of three.js
    browser: str  # version of Chromium
    render: Size
    display: Size
    frames: int
    samples: int  # per pixel of the reference
    scores: list[ThreeScores]
    BENCH = "three"

    def table(self) -> str:
        """Return the Markdown table of the methods."""
        rows = [
            [
                TITLES.get(row.method, f"`supersampler`, {row.method}"),
                figure(row.psnr, 2), figure(row.tpsnr, 2), figure(row.first, 2),
            ]
            for row in self.scores
        ]  # fmt: skip
        caption = (
            f"{size_text(self.render)} to {size_text(self.display)}, {self.frames} frames, reference of "
            f"{self.samples} samples a pixel. PSNR and tPSNR are means over all frames but the first eight. "
            f"tPSNR is the PSNR of changes between frames: flicker and lag lower it. First image: without a "
            f"history. three.js {self.three}, Chromium {self.browser}, software adapter."
        )
        return table(["", "PSNR dB ↑:", "tPSNR dB ↑:", "first image dB ↑:"], rows, caption)
