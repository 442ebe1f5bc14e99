"""PSNR of extrapolated colours at render size, before upscaling, against the same samples shaded.

Table 2 of Wu et al. 2023 (ExtraSS) on one's own shots: each model's colour of an unshaded frame, beside the
last shaded frame warped by motion.
    python bench/studies/extrapolated_colors.py test-shots --models guided-warp,guided-flow
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
import typer

from supersampler.backends.onnx.providers import CPU
from supersampler.extrapolation import Extrapolator, ShadedHistory
from supersampler.frame import Float32, Frame
from supersampler.io.display import auto_exposure, display_transform
from supersampler.io.shot import Shot, ShotFrame
from supersampler.methods.model_file import find_model, read_model_info
from supersampler_bench.cli.options import (
    CACHE,
    JSON,
    RATIO,
    SHOT,
    UPDATE,
    check_page,
    counted,
    listed,
    opened_shots,
    publish,
)
from supersampler_bench.markdown_table import size_text, table
from supersampler_bench.quality.extrapolation import EVERY_SECOND, Alternation, check_gbuffers
from supersampler_bench.quality.metrics import crop, psnr
from supersampler_bench.quality.score_record import shot_record
from supersampler_bench.quality.summaries import BORDER, WARM_UP_FRAMES
from supersampler_bench.quality.warping import warped
from supersampler_bench.record import Record

WARP = "warp"


@dataclass(frozen=True)
class ExtrapolatedScores:
    """PSNR of the unshaded frames of one shot, means over them.

    Attributes:
        shot: the one.
        origin: what else is known of the shot's pixels, ready for JSON.
        psnr: dB, by model, or "warp".
    """

    shot: Shot
    origin: dict[str, Any]
    psnr: dict[str, float]


class _Warping:
    """The last colour, warped by motion from sample to sample."""

    def __init__(self) -> None:
        self._last: tuple[Frame, Float32] | None = None

    def show(self, frame: Frame, *, unshaded: bool) -> Float32:
        """Return the colour of the next frame."""
        color = np.asarray(frame.color, np.float32)
        if unshaded and self._last is not None:
            previous, last_color = self._last
            # `warped` samples at pixel centres; these colours lie at their samples
            apart = np.subtract(frame.jitter, previous.jitter, dtype=np.float32)
            color = warped(last_color, replace(frame, motion=frame.motion + apart))
        self._last = frame, color
        return color


class _Extrapolating:
    """The colour that a model extrapolates."""

    def __init__(self, model: str) -> None:
        self._model = Extrapolator(model, [CPU], 0)
        self._shaded_history: ShadedHistory | None = None

    def show(self, frame: Frame, *, unshaded: bool) -> Float32:
        """Return the colour of the next frame."""
        if unshaded:
            color, self._shaded_history = self._model.extrapolate(
                replace(frame, color=None), self._shaded_history
            )
            return color
        self._shaded_history = self._model.after_shaded(frame, self._shaded_history)
        return np.asarray(frame.color, np.float32)


def measure_colors(
    shot: Shot,
    models: Sequence[str],
    *,
    origin: dict[str, Any] | None = None,
    on_frame: Callable[[], None] = lambda: None,
) -> ExtrapolatedScores:
    """Extrapolate every second frame of a shot, and score its colour.

    Args:
        shot: all of its frames are shaded and have the G-buffers that the models read.
        models: that extrapolate: their names, or folders.
        origin: see `ExtrapolatedScores`.
        on_frame: called after each frame.

    Raises:
        ShotError: G-buffers are missing.
        ModelError, FrameError: see `Extrapolator`.
    """
    for model in models:
        check_gbuffers(shot, model)
    ways: dict[str, _Warping | _Extrapolating] = {WARP: _Warping()}
    ways |= {read_model_info(find_model(model)).method: _Extrapolating(model) for model in models}
    found: dict[str, list[float]] = {name: [] for name in ways}
    alternation = Alternation(EVERY_SECOND)
    for item in shot:
        unshaded = alternation.leaves_unshaded(item)
        for name, way in ways.items():
            color = way.show(item.frame, unshaded=unshaded)
            if unshaded and item.index >= WARM_UP_FRAMES:
                found[name].append(_psnr(color, item))
        on_frame()
    return ExtrapolatedScores(shot, origin or {}, {name: float(np.mean(s)) for name, s in found.items() if s})


def _psnr(color: Float32, item: ShotFrame) -> float:
    truth = np.asarray(item.frame.color, np.float32)
    exposure = item.frame.exposure or auto_exposure(truth)
    image, reference = (crop(display_transform(c, exposure), BORDER) for c in (color, truth))
    return psnr(image, reference)


def colors_record(measured: Sequence[ExtrapolatedScores], models: Sequence[str]) -> dict[str, Any]:
    """Return all values, ready for JSON.

    Args:
        measured: the shots.
        models: that extrapolated.
    """
    return {
        "bench": "extrapolated colors",
        "models": list(models),
        "warm_up_frames": WARM_UP_FRAMES,
        "border": BORDER,
        "shots": [{**shot_record(m.shot), **m.origin, "psnr": m.psnr} for m in measured],
    }


def markdown_table(record: Record) -> str:
    """Return the table of a record as Markdown: a column a shot, with its caption."""
    shots = record["shots"]
    names = [shot["name"] for shot in shots]
    rows = []
    for way in shots[0]["psnr"]:
        scores = [shot["psnr"][way] for shot in shots]
        rows.append([way, *(f"{score:.2f}" for score in (*scores, float(np.mean(scores))))])
    size = size_text(shots[0]["render_size"])
    caption = (
        f"Every second frame is unshaded: its colour at {size}, against that of the same samples shaded; "
        f"without the first {WARM_UP_FRAMES} frames and a border of {BORDER} pixels."
    )
    return table(["PSNR dB", *(f"{name}:" for name in names), "mean:"], rows, caption)


def main(
    shot: SHOT,
    models: Annotated[
        str, typer.Option(help="Extrapolating models: shipped ones or model folders, with commas between.")
    ] = "guided-warp",
    ratio: RATIO = "2",
    cache: CACHE = None,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Score the extrapolated colour of every second frame; frames need the G-buffers that the models read."""
    name, opened = opened_shots(shot, cache, ratio)
    tables = {f"study extrapolated colors {name}": markdown_table}
    check_page(update, tables)
    names = listed(models)
    with counted("frames", sum(len(one) for one, _ in opened)) as advance:
        measured = [measure_colors(one, names, origin=origin, on_frame=advance) for one, origin in opened]
    publish(colors_record(measured, names), tables, json, update)


if __name__ == "__main__":
    typer.run(main)
