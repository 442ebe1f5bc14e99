"""Comparing two records lists what got worse, with the right sign."""

import copy
import json
from pathlib import Path
from typing import Any

import pytest
from typer import Typer
from typer.testing import CliRunner

from studies.compare_records import changes, main
from supersampler import ArgumentError
from supersampler_bench.record import read_record

RESULTS = Path(__file__).parents[3] / "bench" / "results"


def record(name: str) -> dict[str, Any]:
    return read_record(RESULTS / f"{name}.json")


@pytest.mark.parametrize("path", sorted(RESULTS.glob("*.json")), ids=lambda p: p.stem)
def test_a_record_is_no_worse_than_itself(path: Path) -> None:
    content = read_record(path)
    found = changes(content, content)
    assert all(change.worse == 0.0 for change in found)
    assert found
    assert len({change.what for change in found}) == len(found), "each value has a name of its own"


def test_a_lower_psnr_is_worse_by_decibels_and_a_longer_step_by_its_share() -> None:
    before = record("quality-test-shots")
    after = copy.deepcopy(before)
    mean = after["means"][1]
    mean["summary"]["warm_cropped"]["psnr"] -= 0.5
    mean["summary"]["warm_cropped"]["flip"] *= 0.5
    first, *_, last = changes(before, after)
    assert first.what == f"{mean['ratio']} {mean['method']}, psnr"
    assert first.worse == pytest.approx(0.5)
    assert last.what.endswith("flip")
    assert last.worse == pytest.approx(-0.5)

    before = record("latency")
    after = copy.deepcopy(before)
    after["timed"][3]["median"] *= 1.25
    (first, *_) = changes(before, after)
    assert first.worse == pytest.approx(0.25)
    assert before["timed"][3]["setting"]["method"] in first.what


def test_a_figure_of_stress_is_worse_by_its_share_of_the_bound_and_what_breaks_is_named() -> None:
    before = record("stress-extrapolation")
    before["outcomes"][1]["passed"] = True  # whatever the record says
    after = copy.deepcopy(before)
    outcome = after["outcomes"][0]
    outcome["figures"][0]["value"] += 0.5 * outcome["figures"][0]["bound"]
    after["outcomes"][1].update(passed=False, figures=[], error="ValueError: broke")
    broken, first, *_ = changes(before, after)
    assert broken.what == f"{named(after['outcomes'][1])}, out of bounds"
    assert broken.worse == 1.0
    assert first.what == f"{named(outcome)}, {outcome['figures'][0]['name']}, share of the bound"
    assert first.worse == pytest.approx(0.5)


def named(outcome: dict[str, Any]) -> str:
    return " ".join(
        str(part)
        for part in (
            *(outcome[name] for name in ("scenario", "method", "executor", "precision")),
            "x".join(map(str, outcome["display"])),
            outcome["frames"],
        )
    )


def test_rows_are_told_apart_by_sizes_and_names_and_not_by_which_frames_have_references() -> None:
    before = record("quality-plaza")
    after = copy.deepcopy(before)
    after["shots"][0]["reference_frames"].pop()
    found = changes(before, after)
    assert found
    assert found[0].what.startswith("plaza 32 320x180 640x360 truth classes, bilinear, ")


def test_records_of_different_benches_are_refused() -> None:
    with pytest.raises(ArgumentError, match="latency"):
        changes(record("parity"), record("latency"))


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"bench": 3}'])
def test_what_is_no_record_is_refused(content: str, tmp_path: Path) -> None:
    path = tmp_path / "record.json"
    path.write_text(content)
    with pytest.raises(ArgumentError, match=r"record\.json"):
        read_record(path)


def test_the_command_fails_where_something_got_worse(tmp_path: Path) -> None:
    before = RESULTS / "parity.json"
    worse = record("parity")
    worse["results"][2]["psnr"] -= 3.0
    path = tmp_path / "worse.json"
    path.write_text(json.dumps(worse))
    app = Typer()
    app.command()(main)
    same = CliRunner().invoke(app, [str(before), str(before)])
    assert (same.exit_code, "Nothing is worse" in same.output) == (0, True)
    fails = CliRunner().invoke(app, [str(before), str(path)])
    assert fails.exit_code == 1
    assert "+3.000 dB" in fails.output
