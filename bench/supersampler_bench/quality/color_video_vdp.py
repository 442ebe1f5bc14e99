"""ColorVideoVDP (Mantiuk et al. 2024): a perceptual score of a clip, which flicker lowers.

Its package, cvvdp, has the fitted parameters. It is optional, because it needs the torchvision of
the installed torch.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.errors import ArgumentError
from supersampler.frame import Float32
from supersampler.io.display import to_uint8

DISPLAY = "standard_fhd"
"""Display model of the package: 24 inches, 1920x1080, 200 cd/m2, seen from 0.6 m in office light."""
_FRAME_RATE = 30.0  # of shots that state none


def metric() -> Any:
    """Return the metric of the package.

    Raises:
        ModuleNotFoundError: the package is not installed.
        ArgumentError: the installed torchvision does not belong to the installed torch.
    """
    try:
        from pycvvdp import cvvdp
    except ModuleNotFoundError:
        raise
    except (ImportError, RuntimeError) as error:
        raise ArgumentError(
            "torchvision", got=f"not usable ({error})", want="the one that belongs to torch"
        ) from error
    return cvvdp(display_name=DISPLAY, quiet=True)


class Clip:
    """Images of a method and their references, in runs of consecutive frames; `frame_rate`: per second."""

    def __init__(self, frame_rate: float | None) -> None:
        self._frame_rate, self._last = frame_rate or _FRAME_RATE, -2
        self._runs: list[tuple[list[NDArray[np.uint8]], list[NDArray[np.uint8]]]] = []

    def add(self, frame: int, shown: Float32, reference: Float32) -> None:
        """Add a frame by its number: two images (H, W, 3) of display values in [0, 1]."""
        if frame != self._last + 1:
            self._runs.append(([], []))
        self._last = frame
        for images, image in zip(self._runs[-1], (shown, reference), strict=True):
            images.append(to_uint8(image))

    def jod(self) -> float:
        """Return the quality in just-objectionable differences; NaN without frames.

        10 is equal; at 9, three of four people prefer the reference. Runs are weighted by their length.
        """
        if not self._runs:
            return float("nan")
        predict, rate = metric().predict, self._frame_rate
        scores = [
            float(predict(*map(np.stack, run), dim_order="FHWC", frames_per_second=rate)[0])
            for run in self._runs
        ]
        return float(np.average(scores, weights=[len(images) for images, _ in self._runs]))
