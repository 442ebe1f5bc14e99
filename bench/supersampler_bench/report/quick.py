"""Brief measurements for `bench report --quick`, and images of several methods side by side."""

import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

from supersampler import Upscaler
from supersampler.cli.app import missing_extra
from supersampler.errors import ArgumentError
from supersampler.io.compare import About, compare_page
from supersampler.io.display import auto_exposure, display_transform, to_uint8
from supersampler.io.shot import Shot
from supersampler_bench.quality.measure import measure_quality, reference_size
from supersampler_bench.quality.score_table import QualityRecord
from supersampler_bench.quality.scores import shot_row
from supersampler_bench.record import BenchRecord, read_record, write_json
from supersampler_bench.stress.runner import StressRecord, chosen
from supersampler_bench.stress.runner import measure as measure_stress
from supersampler_bench.stress.subjects import subjects
from supersampler_bench.timing.latency import LatencyRecord, measure_latency, measure_limits
from supersampler_bench.timing.pareto import ParetoRecord, measure_pareto, shots_of
from supersampler_model.data.errors import GraphicsError

METHODS = ("bilinear", "taa", "taau", "classifier-small", "classifier")
FRAMES = (15, 23, 31)
"""Frames of the shipped shot that are shown."""


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


_WITH_KERNELS = METHODS[1:]
_DISPLAY = (960, 540)
_STEPS = 8
_FRAMES = 10
_QUALITY = "quality-plaza"


def measure_quickly(folder: Path, on_part: Callable[[str, str], None]) -> None:
    """Measure, and write a record of each part, marked as quick.

    Args:
        folder: where records are written.
        on_part: called with each part's name and a message, when it begins and when it is done.

    Raises:
        ArgumentError: the folder has records that were not measured quickly.
    """
    for path in folder.glob("*.json"):
        if not read_record(path).get("quick"):
            want = "a folder without other records"
            raise ArgumentError("results", got=f"{folder} with {path.name}, which was not", want=want)
    records: dict[str, BenchRecord] = {}
    for name, measure in _PARTS.items():
        on_part(name, "measuring")
        began = time.perf_counter()
        try:
            records[name] = replace(measure(records), quick=True)
        except (GraphicsError, ModuleNotFoundError) as error:
            on_part(name, f"not measured: {missing_extra(error) or error}")
            continue
        write_json(records[name], folder / f"{name}.json")
        on_part(name, f"{time.perf_counter() - began:.0f} s")


def _quality(_: Mapping[str, BenchRecord]) -> BenchRecord:
    shot = Shot.open("plaza")
    return QualityRecord.of([shot_row(shot, measure_quality(shot, METHODS))])


def _latency(_: Mapping[str, BenchRecord]) -> BenchRecord:
    timed = measure_latency(_WITH_KERNELS, [_DISPLAY], ["cpu"], [1, 2], steps=_STEPS)
    return LatencyRecord(2.0, timed, measure_limits())


def _pareto(records: Mapping[str, BenchRecord]) -> BenchRecord:
    scored = cast("QualityRecord", records[_QUALITY])
    points = measure_pareto([scored], _DISPLAY, threads=2, steps=_STEPS)
    return ParetoRecord(shots_of(scored), _DISPLAY, 2, points)


def _parity(_: Mapping[str, BenchRecord]) -> BenchRecord:
    from supersampler_bench.parity import ParityRecord, measure_parity  # needs torch

    return ParityRecord(measure_parity(_WITH_KERNELS, _FRAMES))


def _stress(_: Mapping[str, BenchRecord]) -> BenchRecord:
    stressed = subjects(_WITH_KERNELS, ["cpu"])
    return StressRecord(list(measure_stress(chosen([], quick=True), stressed, quick=True)))


_PARTS: Mapping[str, Callable[[Mapping[str, BenchRecord]], BenchRecord]] = {
    _QUALITY: _quality,
    "pareto": _pareto,
    "latency": _latency,
    "parity": _parity,
    "stress": _stress,
}
"""By the name of the record. Each gets the earlier records."""
