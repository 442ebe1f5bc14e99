"""Tables of the documentation equal their records; the HTML page needs no other file."""

import json
import re
import shutil
from collections.abc import Mapping
from dataclasses import replace
from html import unescape
from pathlib import Path

import pytest
from typer.testing import CliRunner

from supersampler import ArgumentError
from supersampler.io.shot import Shot, ShotWriter
from supersampler_bench.cli import app
from supersampler_bench.parity import Agreement, ParityRecord
from supersampler_bench.quality.score_table import CLIP_COLUMNS
from supersampler_bench.record import BenchRecord, JsonRecord, read_record, write_json
from supersampler_bench.report import quick
from supersampler_bench.report.doc_tables import RESULTS, find_all, read_records
from supersampler_bench.report.page import SECTIONS, write_page
from supersampler_bench.report.quick import split_view
from supersampler_bench.timing.pareto import ParetoPoint, ParetoRecord
from supersampler_model.data.errors import GraphicsError
from supersampler_model.data.scenes.analytic import Plane, checker

ROOT = Path(__file__).parents[3]
PNG = "data:image/png;base64,"


def of_pareto() -> ParetoRecord:
    def point(word: str, milliseconds: float, psnr: float) -> ParetoPoint:
        scores = {c.name: psnr for c in CLIP_COLUMNS[:2]}
        return ParetoPoint(word, "cpu, fp32", 2.0, milliseconds, scores)

    points = [point("bilinear", 9.0, 26.0), point("taau", 8.0, 29.0), point("classifier", 16.0, 30.0)]
    return ParetoRecord(["plaza"], (960, 540), 2, points)


def of_parity(method: str) -> ParityRecord:
    apart = Agreement(method, "cpu, int8", (32, 18), (64, 36), 10, 1e-3, 1e-3, 50.0, 1e-2)
    return ParityRecord([apart])


def page(
    folder: Path, records: Mapping[str, BenchRecord | JsonRecord], view: str = "<p>split & view</p>"
) -> str:
    path = folder / "page" / "report.html"
    write_page(path, {n: r.to_json() if isinstance(r, BenchRecord) else r for n, r in records.items()}, view)
    return path.read_text(encoding="utf-8")


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """One with a table that is recorded, one whose record is not there."""
    (tmp_path / "docs").mkdir()
    shutil.copytree(ROOT / RESULTS, tmp_path / RESULTS)
    (tmp_path / "README.md").write_text("# Title\n<!-- bench:cost -->\n<!-- /bench -->\nend\n")
    (tmp_path / "docs" / "a.md").write_text("<!-- bench:unknown -->\n<!-- /bench -->\n")
    return tmp_path


def test_every_table_of_this_repository_is_what_its_record_says() -> None:
    wrong = [
        f"{block.page}: {block.name} ({block.problem})" for block in find_all(ROOT) if not block.is_recorded
    ]
    assert wrong == [], "run `supersampler bench tables`, or the command of the record that is not there"


def test_tables_are_written_from_records_and_those_without_one_are_named_and_left_alone(
    repository: Path,
) -> None:
    answer = CliRunner().invoke(app, ["tables", str(repository)])
    assert answer.exit_code == 0, answer.output
    assert "a.md: unknown: left alone: there is no record of it" in answer.output
    readme = (repository / "README.md").read_text()
    assert re.search(r"bench:cost -->\n\| method .*\n<!-- /bench -->\nend\n$", readme, re.DOTALL)
    assert (repository / "docs" / "a.md").read_text() == "<!-- bench:unknown -->\n<!-- /bench -->\n"
    assert CliRunner().invoke(app, ["tables", str(repository), "--check"]).exit_code == 0


@pytest.mark.parametrize(("page", "name"), [("README.md", "cost"), ("docs/a.md", "unknown")])
def test_a_number_that_is_in_no_record_fails_the_check_by_its_name(
    repository: Path, page: str, name: str
) -> None:
    CliRunner().invoke(app, ["tables", str(repository)])
    before = (repository / page).read_text()
    changed = re.sub(r"(bench:\w+ -->\n)", r"\g<1>| 1 |\n", before)
    (repository / page).write_text(changed)
    answer = CliRunner().invoke(app, ["tables", str(repository), "--check"])
    assert answer.exit_code == 1
    assert f"{name}: is not what its record says" in answer.output
    assert (repository / page).read_text() == changed


def test_a_record_of_another_version_is_said_to_be_one(repository: Path) -> None:
    path = repository / RESULTS / "cost.json"
    record = json.loads(path.read_text())
    del record["display"]
    write_json(record, path)
    answer = CliRunner().invoke(app, ["tables", str(repository)])
    assert answer.exit_code == 0
    assert "missing required field `display`" in answer.output
    assert "missing required field `display`" in unescape(page(repository, {"cost": record}))


def test_a_folder_without_records_is_named(tmp_path: Path) -> None:
    answer = CliRunner().invoke(app, ["report", "-o", str(tmp_path / "a.html"), "--results", str(tmp_path)])
    assert isinstance(answer.exception, ArgumentError)
    assert "without records" in str(answer.exception)


def test_the_page_has_all_records_figures_and_images_and_needs_nothing_else(tmp_path: Path) -> None:
    records = {n: r for n, r in read_records(ROOT / RESULTS).items() if n != "quality-test-shots"}
    html = page(tmp_path, {**records, "pareto": of_pareto()})
    known = {s.bench for s in SECTIONS}
    for name, record in records.items():
        assert record["bench"] in known
        assert f'<section id="{record["bench"]}">' in html
        assert f"<h3>{name}" in html
        assert record["date"][:10] in html
    assert html.count("<section") == html.count("</section>")
    assert html.count(f'src="{PNG}') >= 2  # time against PSNR and SSIM
    assert 'srcdoc="&lt;p&gt;split &amp; view&lt;/p&gt;"' in html
    assert re.findall(r'(?:src|href)="(?!data:|#)', html) == []
    assert re.findall(r"<link|<script|@import|url\(|https?:", html) == []


def test_names_in_records_are_text(tmp_path: Path) -> None:
    bad = "<script>alert(1)</script>![](http://example.com/a.png)"
    html = page(tmp_path, {"parity": of_parity(bad), bad: of_parity("taau")})
    assert "&lt;script&gt;alert(1)" in html
    assert "<script" not in html
    assert "<img" not in html
    assert '<section id="device">' not in html, "it has no record"


def test_what_was_measured_quickly_says_so_and_no_other(tmp_path: Path) -> None:
    assert "measured quickly" not in page(tmp_path, {"parity": of_parity("taau")})
    assert (
        page(tmp_path, {"parity": replace(of_parity("taau"), quick=True)}).count("measured quickly</span>")
        == 2
    )


def test_quick_measures_part_by_part_and_goes_on_without_opengl(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def without_opengl(_: Mapping[str, BenchRecord]) -> BenchRecord:
        raise GraphicsError("no OpenGL")

    parts = {
        "parity": without_opengl,
        "pareto": lambda _: of_pareto(),
        "latency": lambda known: replace(of_parity(", ".join(known))),
    }
    monkeypatch.setattr(quick, "_PARTS", parts)
    said: dict[str, str] = {}
    quick.measure_quickly(tmp_path, said.__setitem__)
    assert said["parity"] == "not measured: no OpenGL"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["latency.json", "pareto.json"]
    record = read_record(tmp_path / "latency.json")
    assert record["quick"] is True
    assert record["results"][0]["method"] == "pareto"
    quick.measure_quickly(tmp_path, said.__setitem__)  # over its own, but over no others
    write_json(of_parity("taau"), tmp_path / "mine.json")
    with pytest.raises(ArgumentError, match=r"mine\.json, which was not"):
        quick.measure_quickly(tmp_path, said.__setitem__)


def test_quick_makes_the_page_of_what_it_measured_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(quick, "_PARTS", {"parity": lambda _: of_parity("taau")})
    monkeypatch.setattr(quick, "split_view", lambda shot: f"images of {shot.name}")
    answer = CliRunner().invoke(app, ["report", "--quick", "-o", str(tmp_path / "here.html")])
    assert answer.exit_code == 0, answer.output
    assert "parity: measuring" in answer.output
    html = (tmp_path / "here.html").read_text(encoding="utf-8")
    assert "images of plaza" in html
    assert "measured quickly</span>" in html
    assert '<section id="latency">' not in html
    assert (tmp_path / "here-records" / "parity.json").is_file()


def test_the_split_view_has_input_reference_and_every_method(tmp_path: Path) -> None:
    scene, size = Plane(checker, velocity=(1.0, 0.0)), (40, 30)
    with ShotWriter(tmp_path / "shot", name="own", display_size=size, frame_rate=30) as writer:
        for index in range(3):
            writer.write(scene.frame(index, (20, 15)), reference=scene.truth(index, size, samples=2))
    shot = Shot.open(tmp_path / "shot")
    html = split_view(shot, ["bilinear", "taau"], [0, 2])
    for layer in ("input", "reference", "bilinear", "taau"):
        assert re.findall(rf'id="(\d)/{layer}">{PNG}', html) == ["0", "2"]
    assert unescape(html).count("http") == 0
    with pytest.raises(ArgumentError, match="frames is"):
        split_view(shot, ["bilinear"], [7])
