"""Static-tile reuse: time saved and error in partly static scenes, measured with and without it."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any, Literal

import numpy as np

from supersampler import Model, Upscaler, halton_jitter
from supersampler.conventions import jitter_phase_count
from supersampler.frame import Float32, Frame, Size
from supersampler.io.display import display_transform
from supersampler.model import Skip
from supersampler_bench.markdown_table import size_text, table
from supersampler_bench.quality.metrics import psnr
from supersampler_bench.record import Record, machine_name
from supersampler_bench.shots.public_shots import TEST_SHOTS
from supersampler_bench.shots.rendered_frame import rendered_frame
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.sequences import HeldSequence
from supersampler_model.data.shots import render_size
from supersampler_model.data.specs import SequenceSpec

SKIPS: tuple[Literal["exact", "auto"], ...] = ("exact", "auto")
HELD_FRAME = 12  # frame of the test shot whose camera is kept
SCORED = 16  # frames at the end, after four periods of the jitter


@dataclass(frozen=True)
class StaticTileTimes:
    """One scene and method, over the last frames.

    Attributes:
        scene: family of the test shot whose camera is fixed.
        all_static: whether objects stand still, too.
        method: the model's name.
        work: share of a full step that was computed.
        milliseconds: median of a step, by `SKIPS`.
        psnr: against the reference, by `SKIPS`.
    """

    scene: str
    all_static: bool
    method: str
    work: float
    milliseconds: dict[str, float]
    psnr: dict[str, float]


class _Runner:
    """A method with one value of `skip`."""

    def __init__(self, method: str, display: Size, skip: Skip) -> None:
        model = Model.load(method, providers="cpu", executor="cpu")
        self._upscaler = Upscaler(model, display_size=display, skip=skip, validate="off")
        self._image = np.empty((*display[::-1], 3), np.float32)
        self.milliseconds: list[float] = []
        self.work: list[float] = []
        self.psnr: list[float] = []

    def step(self, frame: Frame, truth: Float32 | None) -> None:
        """Step; the frame counts where its reference is known."""
        done = self._upscaler.stats.work
        began = time.perf_counter()
        self._upscaler.step(frame, out=self._image)
        if truth is not None:
            self.milliseconds.append(1e3 * (time.perf_counter() - began))
            self.work.append(self._upscaler.stats.work - done)
            exposure = frame.exposure or 1.0
            shown = display_transform(self._image, exposure)
            self.psnr.append(psnr(shown, display_transform(truth, exposure)))


def measure_skipping(
    families: Sequence[str],
    methods: Sequence[str],
    display: Size,
    *,
    ratio: float = 2.0,
    samples: int = 64,
    on_frame: Callable[[], None] = lambda: None,
) -> list[StaticTileTimes]:
    """Step through each scene, static and with moving objects, with and without reuse, in turns.

    Args:
        families: of the test shots.
        methods: names of models that have kernels.
        display: (width, height) of the images.
        ratio: display over render size.
        samples: a pixel of the references.
        on_frame: called after each frame of a scene.
    """
    renderer = Renderer(display, samples=samples)
    results = []
    for family in families:
        for all_static in (True, False):
            runners = {(m, skip): _Runner(m, display, skip) for m in methods for skip in SKIPS}
            for frame, truth in _frames(renderer, family, ratio, all_static=all_static):
                for runner in runners.values():
                    runner.step(frame, truth)
                on_frame()
            for method in methods:
                milliseconds: dict[str, float] = {s: median(runners[method, s].milliseconds) for s in SKIPS}
                scores: dict[str, float] = {s: float(np.mean(runners[method, s].psnr)) for s in SKIPS}
                work = float(np.mean(runners[method, "auto"].work))
                results.append(StaticTileTimes(family, all_static, method, work, milliseconds, scores))
    return results


def frame_count(ratio: float) -> int:
    """Return the number of frames of a scene."""
    return 4 * jitter_phase_count(ratio) + SCORED


def _frames(
    renderer: Renderer, family: str, ratio: float, *, all_static: bool
) -> Iterator[tuple[Frame, Float32 | None]]:
    count = frame_count(ratio)
    spec = SequenceSpec(family=family, seed=TEST_SHOTS.seeds[family], frames=count)
    sequence = HeldSequence(spec, HELD_FRAME, time_stands=all_static)
    size = render_size(renderer.display_size, ratio)
    truth: Float32 | None = None
    rendered: dict[tuple[float, float], Frame] = {}  # by jitter: static frames repeat
    for index in range(count):
        scene, jitter = sequence.scene(index), halton_jitter(index, ratio)
        if index >= count - SCORED and (truth is None or not all_static):
            truth = renderer.reference(scene).color
        if not all_static or jitter not in rendered:
            rendered[jitter] = rendered_frame(renderer, scene, size, jitter)
        yield rendered[jitter], truth


def skip_record(results: Sequence[StaticTileTimes], display: Size, ratio: float) -> dict[str, Any]:
    """Return all values, ready for JSON."""
    return {
        "bench": "skip",
        "display": list(display),
        "ratio": ratio,
        "held_frame": HELD_FRAME,
        "scored": SCORED,
        "frames": frame_count(ratio),
        "scenes": [asdict(result) for result in results],
    }


def markdown_table(record: Record) -> str:
    """Return the table of a record as Markdown, with its caption."""
    rows = []
    for r in (StaticTileTimes(**row) for row in record["scenes"]):
        (exact, auto), scores = (r.milliseconds[s] for s in SKIPS), (r.psnr[s] for s in SKIPS)
        what = [r.scene, "nothing" if r.all_static else "objects", r.method, f"{100 * r.work:.0f} %"]
        times = [f"{exact:.1f}", f"{auto:.1f}", f"{auto / exact:.2f}"]
        rows.append([*what, *times, *(f"{score:.2f}" for score in scores)])
    caption = (
        f"Images of {size_text(record['display'])} at ratio {record['ratio']:g}, the last "
        f"{record['scored']} of {record['frames']} frames: test shots with a fixed camera. "
        f"{machine_name(record)}."
    )
    headings = ["scene", "moves", "method", "work:", "ms, exact:", "ms:", "share:"]
    return table([*headings, "PSNR dB, exact:", "PSNR dB:"], rows, caption)
