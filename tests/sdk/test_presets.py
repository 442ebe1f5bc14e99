"""Presets are the measured frontier points that their rule chooses."""

from pathlib import Path

from supersampler.upscaler import PRESETS
from supersampler_bench.record import read_record
from supersampler_bench.specs import parse_spec
from supersampler_bench.timing.pareto import ParetoRecord, at_ratio, presets

MEASURED = Path(__file__).parents[2] / "bench" / "supersampler_bench" / "pareto.json"


def test_presets_are_the_frontier_points_chosen_by_their_rule() -> None:
    chosen = presets(at_ratio(ParetoRecord.from_json(read_record(MEASURED)).points, 2.0))
    shipped = {name: (p.model, p.precision) for name, p in PRESETS.items()}
    assert {
        name: (s.model, s.precision) for name, s in ((n, parse_spec(text)) for n, text in chosen.items())
    } == shipped
