"""Colours that were drawn, held against what the same samples have shaded, before anything upscales them.

Table 2 of Wu et al. 2023 (ExtraSS) on one's own shots: what a model makes of a hidden frame, beside the last
shaded frame warped by motion.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from supersampler.backends.onnx.providers import CPU
from supersampler.extrapolation import Extrapolator, ShadedHistory
from supersampler.frame import Float32, Frame
from supersampler.io.display import auto_exposure, decibels, display_transform
from supersampler.io.shot import Shot, ShotFrame
from supersampler.methods.model_file import find_model, read_model_info
from supersampler_bench.extrapolation import EVERY_SECOND, Alternation, check_gbuffers
from supersampler_bench.record import Record, shot_record
from supersampler_bench.scores import BORDER, WARM_UP_FRAMES
from supersampler_bench.warping import warped

WARP = "warp"


@dataclass(frozen=True)
class DrawnScores:
    """PSNR of hidden frames of one shot, means over them.

    Attributes:
        shot: the one.
        origin: what else is known of the shot's pixels, ready for JSON.
        psnr: dB, by what drew them.
    """

    shot: Shot
    origin: dict[str, Any]
    psnr: dict[str, float]


class _Warping:
    """The last picture, warped by motion from sample to sample."""

    def __init__(self) -> None:
        self._last: tuple[Frame, Float32] | None = None

    def show(self, frame: Frame, *, hidden: bool) -> Float32:
        """Return the colour of the next frame."""
        color = np.asarray(frame.color, np.float32)
        if hidden and self._last is not None:
            before, picture = self._last
            apart = np.subtract(frame.jitter, before.jitter, dtype=np.float32)  # places are those of samples
            color = warped(picture, replace(frame, motion=frame.motion + apart))
        self._last = frame, color
        return color


class _Drawing:
    """What a model draws."""

    def __init__(self, model: str) -> None:
        self._model = Extrapolator(model, [CPU], 0)
        self._past: ShadedHistory | None = None

    def show(self, frame: Frame, *, hidden: bool) -> Float32:
        """Return the colour of the next frame."""
        if hidden:
            color, self._past = self._model.extrapolate(replace(frame, color=None), self._past)
            return color
        self._past = self._model.after_shaded(frame, self._past)
        return np.asarray(frame.color, np.float32)


def measure_drawn(
    shot: Shot,
    models: Sequence[str],
    *,
    origin: dict[str, Any] | None = None,
    on_frame: Callable[[int], None] = lambda _: None,
) -> DrawnScores:
    """Hide every second frame of a shot, draw its colour, and score that.

    Args:
        shot: all of its frames are shaded and have the G-buffers that the models read.
        models: that extrapolate: their names, or folders.
        origin: see `DrawnScores`.
        on_frame: called with the number of frames done, after each.

    Raises:
        ShotError: G-buffers are missing.
        ModelError, FrameError: see `Extrapolator`.
    """
    for model in models:
        check_gbuffers(shot, model)
    ways: dict[str, _Warping | _Drawing] = {WARP: _Warping()}
    ways |= {read_model_info(find_model(model)).method: _Drawing(model) for model in models}
    found: dict[str, list[float]] = {name: [] for name in ways}
    alternation = Alternation(EVERY_SECOND)
    for item in shot:
        hidden = alternation.hides(item)
        for name, way in ways.items():
            color = way.show(item.frame, hidden=hidden)
            if hidden and item.index >= WARM_UP_FRAMES:
                found[name].append(_psnr(color, item))
        on_frame(item.index + 1)
    return DrawnScores(shot, origin or {}, {name: float(np.mean(s)) for name, s in found.items() if s})


def _psnr(color: Float32, item: ShotFrame) -> float:
    truth = np.asarray(item.frame.color, np.float32)
    exposure = item.frame.exposure or auto_exposure(truth)
    off = display_transform(color, exposure) - display_transform(truth, exposure)
    return decibels(float(np.square(off[BORDER:-BORDER, BORDER:-BORDER], dtype=np.float64).mean()))


def drawn_record(measured: Sequence[DrawnScores], models: Sequence[str]) -> dict[str, Any]:
    """Return all values, ready for JSON.

    Args:
        measured: the shots.
        models: that drew.
    """
    return {
        "bench": "drawn",
        "models": list(models),
        "warm_up_frames": WARM_UP_FRAMES,
        "border": BORDER,
        "shots": [{**shot_record(m.shot), **m.origin, "psnr": m.psnr} for m in measured],
    }


def markdown_table(record: Record) -> str:
    """Return the table of a record as Markdown: a column a shot, with its caption."""
    shots = record["shots"]
    names = [shot["name"] for shot in shots]
    rows = [
        f"| PSNR dB | {' | '.join(names)} | mean |",
        f"| --- | {' | '.join('---:' for _ in names)} | ---: |",
    ]
    for way in shots[0]["psnr"]:
        scores = [shot["psnr"][way] for shot in shots]
        cells = [f"{score:.2f}" for score in (*scores, float(np.mean(scores)))]
        rows.append(f"| {way} | {' | '.join(cells)} |")
    w, h = shots[0]["render_size"]
    caption = (
        f"Every second frame is hidden: its colour at {w}x{h}, against what the same samples have shaded; "
        f"without the first {WARM_UP_FRAMES} frames and a border of {BORDER} pixels."
    )
    return "\n".join([*rows, "", caption])
