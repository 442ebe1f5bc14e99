"""Output of a measurement: JSON record, table on the terminal, block of a Markdown file."""

import io
import json
import re
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from checker_shot import write_checker_shot
from supersampler import ArgumentError, __version__
from supersampler.io.shot import ClassMaps, Shot
from supersampler_bench.quality.score_table import (
    CORNER_COLUMNS,
    NO_CLASSES,
    NO_KINDS,
    QualityRecord,
    caption,
    markdown_table,
    terminal_tables,
)
from supersampler_bench.quality.scores import (
    FRAME_METRICS,
    FrameScores,
    MethodRow,
    MethodScores,
    ShotRow,
    shot_row,
)
from supersampler_bench.record import Provenance, age_of, read_record, write_json
from supersampler_bench.report.doc_tables import update_block
from upscale_runs import run

README = "# Title\n<!-- bench:quality plaza -->\nold\n<!-- /bench -->\ntext\n<!-- /bench -->\n"


def result(method: str, psnr: float, flip: float) -> MethodScores:
    scores = dict.fromkeys(FRAME_METRICS, float("nan"))
    scores |= {"psnr": psnr, "flip": flip, "pixels_moving": 0.0, "pixels_disoccluded": 0.0}
    scores |= {"warped_error_difference": 0.00123, "srred": 3.0, "trred": 4.0}
    return MethodScores(method, [FrameScores(8, full=scores, cropped=scores)])


RESULTS = [result("worse", 20.001, 0.2), result("better", 21.0, 0.1)]


def test_the_best_figure_of_a_column_is_bold_whichever_side_is_better() -> None:
    _, _, worse, better, *_ = markdown_table("title", [MethodRow.of(r) for r in RESULTS]).split("\n")
    assert worse.startswith("| worse | 20.00 | – | 0.2000 |")
    assert better.startswith("| better | **21.00** | – | **0.1000** |")
    assert worse.split(" | ")[5] == better.split(" | ")[5] == "**1.23**"
    rows = [MethodRow.of(r) for r in RESULTS]
    for row, trail in zip(rows, (-0.002, 0.002), strict=True):
        row.summary["warm_cropped"]["trail"] = trail
    _, _, *either = markdown_table("title", rows, CORNER_COLUMNS).split("\n")
    assert "| **-0.002** |" in either[0]
    assert "| **0.002** |" in either[1]


def test_tables_of_many_methods_fit_into_80_characters_with_all_names_and_figures() -> None:
    names = [f"classifier-small:{setting}" for setting in ("fp32", "fp16", "gpu", "off", "x2", "int8")]
    rows = [MethodRow.of(result(f"{name}:off", 21.0 + i, 0.1)) for i, name in enumerate(names)]
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(*terminal_tables("title", rows))
    text = console.export_text()
    headings: list[str] = []
    for table in text.split("┏")[1:]:
        lines = [line.split("┃")[2:-1] for line in table.splitlines() if line.startswith("┃")]
        headings += ["".join(map(str.strip, cells)) for cells in zip(*lines, strict=True)]
    assert headings == [row.method for row in rows]
    assert all(f" {21.0 + i:.2f} " in text for i in range(len(names)))


def test_thin_pixels_have_a_column_after_aliased_ones_if_any_method_has_them() -> None:
    rows = [MethodRow.of(r) for r in RESULTS]
    without = markdown_table("title", rows)
    assert "thin" not in without
    headings = without.split("\n")[0]
    rows[1].summary["warm_cropped"]["psnr_thin"] = rows[1].summary["all_full"]["psnr_thin"] = 23.0
    first, _, worse, better, *_ = markdown_table("title", rows).split("\n")
    assert first == headings.replace("aliased ↑ |", "aliased ↑ | PSNR dB, thin ↑ |")
    assert [row.split(" | ")[9] for row in (worse, better)] == ["–", "**23.00**"]


@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_replacing_a_block_keeps_the_text_around_it(tmp_path: Path, line_end: str) -> None:
    file = tmp_path / "README.md"
    file.write_bytes(README.replace("\n", line_end).encode())
    update_block(file, "quality plaza", "new\\1\ntable")
    assert file.read_bytes() == README.replace("old", "new\\1\ntable").replace("\n", line_end).encode()
    assert [path.name for path in tmp_path.iterdir()] == ["README.md"]


@pytest.mark.parametrize(("text", "found"), [("no marks", 0), (README + README, 2)])
def test_a_missing_file_is_named_and_one_without_one_block_is_left_alone(
    tmp_path: Path, text: str, found: int
) -> None:
    file = tmp_path / "README.md"
    with pytest.raises(ArgumentError, match=r"README\.md"):
        update_block(file, "quality plaza", "new")
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ArgumentError, match=rf"{found} blocks .*Write the lines <!-- bench:"):
        update_block(file, "quality plaza", "new")
    assert file.read_text(encoding="utf-8") == text


def test_a_record_holds_its_provenance_and_is_strict_json(tmp_path: Path) -> None:
    file = tmp_path / "results" / "quality.json"
    write_json(QualityRecord.of([shot_row(Shot.open("plaza"), RESULTS)]), file)
    record = json.loads(file.read_text(encoding="utf-8"))
    assert record["versions"]["supersampler"] == __version__
    assert record["machine"]["cores"] >= 1
    [shot] = record["shots"]
    assert len(shot["shot_json_sha256"]) == 64
    assert shot["reference_frames"][0] == 11
    assert shot["masks"] == "truth classes"
    assert shot["methods"][1]["summary"]["warm_cropped"]["psnr"] == 21.0
    assert shot["methods"][1]["summary"]["all_full"]["tpsnr"] is None
    assert shot["methods"][0]["frames"][0]["cropped"]["psnr"] == 20.001
    assert record["means"] == []


def test_records_of_equal_measurements_differ_only_in_date_and_duration() -> None:
    first, second = (QualityRecord.of([shot_row(Shot.open("plaza"), RESULTS)]).to_json() for _ in range(2))
    for record in (first, second):
        assert record.pop("date")
        assert record.pop("seconds") >= 0.0
    assert repr(first) == repr(second)


def test_the_markdown_table_says_what_was_measured() -> None:
    title = caption(ShotRow.of(Shot.open("plaza")))
    lines = markdown_table(title, [MethodRow.of(r) for r in RESULTS]).split("\n")
    assert len({line.count("|") for line in lines[:4]}) == 1
    assert lines[-1].startswith("plaza, 320x180 to 640x360: 5 reference frames of 16, without the")


def test_the_quality_command_prints_and_writes_a_record(tmp_path: Path) -> None:
    aliased = ClassMaps(np.zeros((60, 80), np.uint8), np.ones((60, 80), np.uint8))
    write_checker_shot(tmp_path / "shot", classes=aliased)
    values = tmp_path / "values.json"
    options = ["--methods", "bilinear,classifier-small", "--json", str(values)]
    answer = run("bench", "quality", tmp_path / "shot", *options)
    assert answer.exit_code == 0, answer.output
    assert "aliasing: geometry" in answer.stdout
    assert "STRRED" in answer.stdout
    assert "[bold]" not in answer.stdout
    record = QualityRecord.from_json(read_record(values))
    assert [len(method.frames) for method in record.shots[0].methods] == [10, 10]
    assert f"{record.shots[0].methods[1].known()['psnr']:.2f}" in answer.stdout
    first, clip, classes, *_ = record.tables("quality own").values()
    assert "STRRED" not in first
    assert clip.count("STRRED") == 2  # without and with warm-up and border
    assert classes.count("`classifier-small`") == 2


def test_several_shots_have_tables_of_their_mean_also_when_the_record_was_read_back(tmp_path: Path) -> None:
    classes = np.ones((2, 3, 3), np.int64)
    measured = [
        MethodScores(r.method, [replace(f, cropped_classes=classes) for f in r.frames]) for r in RESULTS
    ]
    record = QualityRecord.of([shot_row(Shot.open("plaza"), measured, {"ratio": 2.0}) for _ in range(2)])
    first, clip, classes_text, corners, kinds = record.tables("quality shots").values()
    assert first.splitlines()[-1].startswith("Mean of the shots plaza, plaza at ratio 2 to 640x360")
    assert clip.count("Mean of the shots") == 2
    assert "**12.0**" in clip
    assert "33.3 %" in classes_text
    assert classes_text.count("Mean of the shots") == 1
    assert "trail" not in corners
    assert kinds == NO_KINDS
    write_json(record, tmp_path / "record.json")
    again = QualityRecord.from_json(read_record(tmp_path / "record.json"))
    assert again.tables("quality shots") == record.tables("quality shots")
    without = QualityRecord.of([shot_row(Shot.open("plaza"), RESULTS)])
    assert without.tables("quality plaza")["quality plaza classes"] == NO_CLASSES


def test_a_file_that_no_bench_wrote_is_kept(tmp_path: Path) -> None:
    (tmp_path / "notes").write_text('{"mine": 1}')
    answer = run("bench", "parity", "--json", tmp_path / "notes")
    assert (answer.exit_code, answer.stderr.count("\n")) == (1, 1)
    assert "notes: already exists, and is not a" in answer.stderr
    assert (tmp_path / "notes").read_text() == '{"mine": 1}'


@pytest.mark.parametrize(
    "row", ["taau:fp32", "taau+guided-warp", "guided-warp+taau", "classifier, taau", "taau x2"]
)
def test_a_table_says_which_models_have_changed_since_it_was_measured(row: str) -> None:
    record: dict[str, Any] = {
        "rows": [{"method": row}, {"method": "classifier"}, {"method": "out/bilinear"}],
        **asdict(Provenance.now()),
    }
    assert age_of(record) == ""
    record["model_digests"]["bilinear"] = "other"
    assert age_of(record) == ""  # the record has no row of it
    record["model_digests"]["taau"] = "other"
    assert re.fullmatch(
        r"Measured on 20\d\d-\d\d-\d\d( at commit [0-9a-f]{8})? with another version of taau.", age_of(record)
    )
    del record["model_digests"]
    assert age_of(record).endswith("before records named the models' versions.")
    assert age_of({"rows": ["some text"], "date": "2026-01-01"}) == ""


def test_a_table_says_when_the_shipped_shot_has_changed_since_it_was_measured() -> None:
    record = QualityRecord.of([shot_row(Shot.open("plaza"), RESULTS)]).to_json()
    assert age_of(record) == ""
    record["shots"][0]["shot_json_sha256"] = "other"
    assert age_of(record).endswith("with another version of plaza.")
    record["shots"] = ["plaza"]  # as in a record of `bench pareto`
    assert age_of(record) == ""
