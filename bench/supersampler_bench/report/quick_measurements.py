"""Brief measurements for `bench report --quick`: rough numbers of this machine."""

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from supersampler.cli.app import missing_extra
from supersampler.errors import ArgumentError
from supersampler.io.shot import Shot
from supersampler_bench.quality.measure import measure_quality
from supersampler_bench.quality.score_record import quality_record, shot_scores
from supersampler_bench.record import Record, read_record, setting, write_json
from supersampler_bench.report.image_comparison import METHODS
from supersampler_bench.stress.report import draw_sheets, stress_record
from supersampler_bench.stress.runner import chosen
from supersampler_bench.stress.runner import measure as measure_stress
from supersampler_bench.stress.subjects import subjects
from supersampler_bench.timing.latency import latency_record, measure_latency, measure_limits
from supersampler_bench.timing.pareto import measure_pareto, pareto_record, shots_of
from supersampler_model.data.errors import GraphicsError

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
    records: dict[str, Record] = {}
    for name, measure in _PARTS.items():
        on_part(name, "measuring")
        began = time.perf_counter()
        try:
            records[name] = {**measure(records, folder / name), **setting(), "quick": True}
        except (GraphicsError, ModuleNotFoundError) as error:
            on_part(name, f"not measured: {missing_extra(error) or error}")
            continue
        write_json(records[name], folder / f"{name}.json")
        on_part(name, f"{time.perf_counter() - began:.0f} s")


def _quality(_: Mapping[str, Record], __: Path) -> dict[str, Any]:
    shot = Shot.open("plaza")
    return quality_record([shot_scores(shot, measure_quality(shot, METHODS))])


def _latency(_: Mapping[str, Record], __: Path) -> dict[str, Any]:
    timed = measure_latency(_WITH_KERNELS, [_DISPLAY], ["cpu"], [1, 2], steps=_STEPS)
    return latency_record(timed, measure_limits(), 2.0)


def _pareto(records: Mapping[str, Record], _: Path) -> dict[str, Any]:
    scored = records[_QUALITY]
    points = measure_pareto([scored], _DISPLAY, threads=2, steps=_STEPS)
    return pareto_record(points, shots_of(scored), _DISPLAY, 2)


def _parity(_: Mapping[str, Record], __: Path) -> dict[str, Any]:
    from supersampler_bench.parity import measure_parity, parity_record  # needs torch

    return parity_record(measure_parity(_WITH_KERNELS, _FRAMES))


def _stress(_: Mapping[str, Record], folder: Path) -> dict[str, Any]:
    outcomes = list(measure_stress(chosen([], quick=True), subjects(_WITH_KERNELS, ["cpu"]), quick=True))
    draw_sheets(outcomes, folder)
    return stress_record(outcomes, quick=True)


_PARTS: Mapping[str, Callable[[Mapping[str, Record], Path], dict[str, Any]]] = {
    _QUALITY: _quality,
    "pareto": _pareto,
    "latency": _latency,
    "parity": _parity,
    "stress": _stress,
}
"""By the name of the record. Each gets the earlier records and a folder for its own figures."""
