"""ColorVideoVDP (Mantiuk et al. 2024), where its package is installed: one number for a whole clip.

Seen on the package's standard 4K display. Frames are kept in eight bits until the clip is whole: three bytes
a display pixel, of the reference and of each method.
"""

from collections.abc import Sequence
from importlib.util import find_spec

import numpy as np

from supersampler.errors import SupersamplerError
from supersampler.frame import Float32
from supersampler.io.display import to_uint8
from supersampler.io.images import Bytes
from supersampler_bench.metrics import crop


def require() -> None:
    """Find out before anything is measured whether the package is there.

    Raises:
        SupersamplerError: it is not.
    """
    if find_spec("pycvvdp") is None:
        raise SupersamplerError(
            "ColorVideoVDP needs the package cvvdp; install it with: pip install 'supersampler[cvvdp]'"
        )


class Clips:
    """The pictures of all methods and the references, until the shot is over.

    Args:
        methods: how many there are.
        frame_rate: frames a second.

    Raises:
        SupersamplerError: the package is not installed.
    """

    def __init__(self, methods: int, frame_rate: float) -> None:
        require()
        self._frame_rate = frame_rate
        self._numbers: list[int] = []
        self._references: list[Bytes] = []
        self._pictures: list[list[Bytes]] = [[] for _ in range(methods)]

    def add(self, frame: int, reference: Float32, pictures: Sequence[Float32]) -> None:
        """Keep a frame that has a reference: (H, W, 3) each, as a screen shows it."""
        self._numbers.append(frame)
        self._references.append(to_uint8(reference))
        for clip, picture in zip(self._pictures, pictures, strict=True):
            clip.append(to_uint8(picture))

    def score(self, method: int, first: int, border: int) -> float:
        """Return the quality of a method's clip from frame `first` on, without `border` pixels.

        Just-objectionable differences (JOD): 10 is equal; at 9, three of four people prefer the reference.
        Where references are not of consecutive frames, the mean over the runs that are, by their length; NaN
        where there is no frame.
        """
        runs = _runs([(i, number) for i, number in enumerate(self._numbers) if number >= first])
        if not runs:
            return float("nan")
        scores = [self._predict(self._pictures[method], run, border) for run in runs]
        return float(np.average(scores, weights=[len(run) for run in runs]))

    def _predict(self, pictures: list[Bytes], run: list[int], border: int) -> float:
        import pycvvdp

        shown, truth = (np.stack([crop(of[i], border) for i in run]) for of in (pictures, self._references))
        metric = pycvvdp.cvvdp(display_name="standard_4k", quiet=True)
        quality, _ = metric.predict(shown, truth, dim_order="FHWC", frames_per_second=self._frame_rate)
        return float(quality)


def _runs(numbered: Sequence[tuple[int, int]]) -> list[list[int]]:
    """Part indices, each with the number of its frame, where a frame is left out."""
    runs: list[list[int]] = []
    last = None
    for index, number in numbered:
        if last is None or number != last + 1:
            runs.append([])
        runs[-1].append(index)
        last = number
    return runs
