"""Tests of the names of results: those of the frames, those of --name, and names that are refused."""

import json
from pathlib import Path
from typing import Any

import pytest

from upscale_runs import OURS, files, images, refusal, upscale, write_renders, write_shot


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_shot(tmp_path_factory.mktemp("shots") / "tiny", 2)


TWO = {10: "beauty.0010", 11: "beauty.0011"}


@pytest.mark.parametrize(
    ("names", "pattern", "want"),
    [
        (TWO, "", ["beauty.0010", "beauty.0011"]),
        (TWO, "beauty.####.exr", ["beauty.0010", "beauty.0011"]),
        (TWO, "beauty.%04d.exr", ["beauty.0010", "beauty.0011"]),
        ({9: "b_9", 10: "b_10"}, "b_*.exr", ["b_0009", "b_0010"]),
        ({10: "v2_00010_left"}, "v2_#####_left.exr", ["v2_00010_left"]),
        ({7: "00007"}, "", ["00007"]),
        ({1: "ku\u0308che, 5% (it's @home)_1"}, "", ["ku\u0308che, 5% (it's @home)_0001"]),
    ],
)
def test_results_are_called_as_the_frames(tmp_path: Path, names: Any, pattern: str, want: list[str]) -> None:
    renders = write_renders(tmp_path / "in", names)
    upscale(renders / pattern, tmp_path / "out", *OURS)
    assert [*images(tmp_path / "out")] == [f"{name}.exr" for name in want]


@pytest.mark.parametrize(
    ("name", "want"),
    [
        ("final_####", "final_0001"), ("final.%05d", "final.00001"), ("f%d", "f1"), ("f%04d_4k", "f0001_4k"),
        ("#", "1"), ("ü ####", "ü 0001"),
    ],
)  # fmt: skip
def test_every_format_has_the_names_of_the_option(shot: Path, tmp_path: Path, name: str, want: str) -> None:
    formats = ("--format", "png", "--format", "exr", "--format", "tif")
    for said in ("", "All 1 frames are complete already"):
        assert said in upscale(shot, tmp_path, "--name", name, *formats, "--frames", "1").stderr
        assert [*images(tmp_path)] == [f"{kind}/{want}.{kind}" for kind in ("exr", "png", "tif")]


@pytest.mark.parametrize(
    "name",
    ["beauty", "", "../####", "a/####", "/####", "a\\####", "C:####", "####.####", "##_%04d", "%04d_%04d",
     ".####", "a\n####", "a*####", "####.exr", "beauty.####.png", "%99999999999d", "####" * 3 + " ####"],
)  # fmt: skip
def test_a_name_without_exactly_one_number_is_refused(shot: Path, tmp_path: Path, name: str) -> None:
    message = refusal("upscale", shot, "-o", tmp_path / "out", "--name", name)
    assert "--name is " in message
    assert "want a file name without extension, with one run of # for the number" in message
    assert not (tmp_path / "out").exists()


def test_two_sequences_in_a_folder_are_not_one_run(tmp_path: Path) -> None:
    renders = write_renders(tmp_path / "in", {1: "left.0001"})
    write_renders(renders, {1: "right.0001"})
    options = ("--name", "####", "--method", "bilinear", *OURS)
    upscale(renders / "left.####.exr", tmp_path / "out", *options)
    before = files(tmp_path / "out")
    message = refusal("upscale", renders / "right.####.exr", "-o", tmp_path / "out", *options)
    assert "names was left.####, is now right.####" in message
    assert files(tmp_path / "out") == before


PATTERNS = (
    "../####.exr", "a/b/####.exr", "/####.exr", "exr/../####.exr", "png/####.exr", "exr/exr/####.exr",
    "exr/####.####.exr", ".####.exr", "..####.exr", "\\####.exr", "C:####.exr", "####.json", "####.html",
    "recorded/../####.exr", "video.####.mp4", "upscale.####.json", "#/####.exr", "a\n####.exr", "####.jpg",
    "../0000.exr", "/etc/passwd", "0000.html", "",
)  # fmt: skip
EVIL: list[Any] = [
    *({pattern: 9} for pattern in PATTERNS), {"####.exr": -1}, {"####.exr": True}, {"####.exr": 10**400},
    {"####.exr": "9"}, {"compare.html": 2}, ["0000.html"], "0000.html",
]  # fmt: skip


@pytest.mark.parametrize("record", ["upscale.json", "upscale.0000-0001.json"])
def test_a_record_with_foreign_entries_removes_nothing(shot: Path, tmp_path: Path, record: str) -> None:
    out = tmp_path / "below" / "out"
    options = ("--frames", "0-1") if record != "upscale.json" else ()
    upscale(shot, out, *options)
    content = json.loads((out / record).read_text())
    names = "0000.exr", ".0000.exr", "0000.html", "0000.json", ".0000.deadbeef.partial.exr", "victim"
    for place in (tmp_path, out.parent, out / "a" / "b", out / "png", out / "exr" / "exr"):
        place.mkdir(parents=True, exist_ok=True)
        for name in names:
            (place / name).write_bytes(b"mine")
    for evil in EVIL:
        listed = {**content["files"], **evil} if isinstance(evil, dict) else evil
        (out / record).write_text(json.dumps({**content, "files": listed}))
        before = files(tmp_path)
        message = refusal("upscale", shot, "-o", out, "--method", "bilinear", *options, "--overwrite")
        assert f"{record}: " in message
        if evil in EVIL[: len(PATTERNS)]:
            assert f"lists {next(iter(evil))!r}: 9, which no run writes" in message
        assert files(tmp_path) == before


@pytest.mark.parametrize("frames", ["0-3", "../0-1", "1-0", 3, None, "", "0-1,"])
def test_a_record_under_a_wrong_name_removes_nothing(shot: Path, tmp_path: Path, frames: object) -> None:
    upscale(shot, tmp_path, "--frames", "0-1")
    path = tmp_path / "upscale.0000-0001.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "frames": frames}))
    before = files(tmp_path)
    for ranges in ("0-1", "1"):
        message = refusal("upscale", shot, "-o", tmp_path, "--frames", ranges, "--overwrite")
        assert "upscale.0000-0001.json: " in message
    assert files(tmp_path) == before
