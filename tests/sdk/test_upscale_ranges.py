"""Tests of `upscale --frames`: which frames are written, and that they are those of the whole run."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from supersampler.io.display import decibels
from upscale_runs import OURS, files, images, pixels, refusal, upscale, write_renders, write_shot


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """24 frames with a cut at 10, of which the light drifts."""
    return write_shot(tmp_path_factory.mktemp("shots") / "drift", 24, cuts=(10,), light=1.06)


@pytest.fixture(scope="module")
def whole(shot: Path) -> Path:
    """Results of the whole shot in PNG, which show its exposure."""
    upscale(shot, shot.parent / "whole", "--preroll", "4", "--format", "png")
    return shot.parent / "whole"


def test_a_range_whose_preroll_reaches_a_cut_has_the_whole_runs_bits(shot: Path, tmp_path: Path) -> None:
    upscale(shot, tmp_path / "whole", "--preroll", "3", method="taau")
    part = upscale(shot, tmp_path / "part", "--frames", "10-13", "--preroll", "3", method="taau")
    assert "4 frames in" in part.stderr  # none before the cut
    want = images(tmp_path / "whole")
    assert images(tmp_path / "part") == {f"{n:04d}.exr": want[f"{n:04d}.exr"] for n in (10, 11, 12, 13)}


def test_a_range_of_a_moving_shot_is_nearer_to_the_whole_run_with_preroll(shot: Path, tmp_path: Path) -> None:
    upscale(shot, tmp_path / "whole", "--preroll", "12", method="taau")
    found = {}
    for preroll in (0, 12):
        folder = tmp_path / str(preroll)
        upscale(shot, folder, "--frames", "23", "--preroll", preroll, method="taau")
        a, b = pixels(folder / "0023.exr"), pixels(tmp_path / "whole" / "0023.exr")
        found[preroll] = decibels(float(np.square((a - b) / b.max()).mean()))
    assert found[12] >= 50.0
    assert found[0] < found[12] - 10.0


@pytest.mark.parametrize("preroll", [0, 3])
def test_a_range_has_the_whole_runs_exposure(shot: Path, whole: Path, tmp_path: Path, preroll: int) -> None:
    upscale(shot, tmp_path, "--frames", "18-19", "--preroll", preroll, "--format", "png")
    want = images(whole)
    assert images(tmp_path) == {name: want[name] for name in ("0018.png", "0019.png")}


def test_a_gap_is_named_only_inside_the_range(tmp_path: Path) -> None:
    there = [*range(4), *range(6, 12), *range(14, 16)]
    renders = write_renders(tmp_path / "in", {n: f"f.{n:04d}" for n in there})
    options = ("--preroll", "2", *OURS)
    done = upscale(renders, tmp_path / "out", "--frames", "9-11", *options)
    assert "exposure begin at frame 7: frame 4 to 5 between f.0003.exr" in done.stderr
    assert [*images(tmp_path / "out")] == ["f.0009.exr", "f.0010.exr", "f.0011.exr"]
    for ranges, missing in (("9-15", "12 to 13"), ("10-13", "12 to 13"), ("7", "5"), ("0-15", "4 to 5")):
        command = ("upscale", renders, "-o", tmp_path / "other", "--frames", ranges, *options)
        assert f"frame {missing} between f.00" in refusal(*command)
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize(("ranges", "missing"), [("20-24", "24"), ("90-95", "90"), ("30", "30")])
def test_a_frame_that_is_missing_is_named(shot: Path, tmp_path: Path, ranges: str, missing: str) -> None:
    message = refusal("upscale", shot, "-o", tmp_path / "out", "--frames", ranges)
    assert f"has no frame {missing}. It ends with frame 23." in message
    assert not (tmp_path / "out").exists()


def test_a_frame_before_the_first_is_named_with_the_first(tmp_path: Path) -> None:
    renders = write_renders(tmp_path / "in", {n: f"f.{n}" for n in range(1001, 1006)})
    message = refusal("upscale", renders, "-o", tmp_path / "out", "--frames", "1000-1002", *OURS)
    assert "has no frame 1000. It begins with frame 1001." in message


@pytest.mark.parametrize("command", ["upscale", "denoise"])
@pytest.mark.parametrize("ranges", ["1-3", "5"])
def test_a_range_without_a_frame_is_named_as_given(tmp_path: Path, command: str, ranges: str) -> None:
    renders = write_renders(tmp_path / "in", {n: f"f.{n}" for n in (1001, 1002)})
    message = refusal(command, renders, "-o", tmp_path / "out", "--frames", ranges, *OURS)
    named = "from 1 to 3" if ranges == "1-3" else "from 5 to 5"
    assert f"has no frame {named}. Its frames are 1001 to 1002" in message


def test_a_range_over_a_whole_run_names_the_option_that_differs(shot: Path, tmp_path: Path) -> None:
    upscale(shot, tmp_path)
    message = refusal("upscale", shot, "-o", tmp_path, "--frames", "3", "--method", "bilinear", "--overwrite")
    assert "at rest was converge, is now off. It is off by default with --frames" in message
    assert "add --at-rest converge." in message
    upscale(shot, tmp_path, "--frames", "3", "--overwrite", "--at-rest", "converge")


@pytest.mark.parametrize("ranges", ["", "5-", "a", "5-3", "3,4", "10:20", "1x2", "3--5", "--3"])
def test_an_invalid_range_is_refused(shot: Path, tmp_path: Path, ranges: str) -> None:
    message = refusal("upscale", shot, "-o", tmp_path / "out", f"--frames={ranges}")
    assert "want FIRST-LAST, such as 10-50" in message


@pytest.mark.long  # in two processes
def test_two_ranges_at_once_into_one_folder_are_the_whole(shot: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "supersampler", "upscale", str(shot), "-o", str(tmp_path / "out")]
    options = ["--method", "bilinear", "--preroll", "2", "--threads", "1"]
    workers = [
        subprocess.Popen([*command, *options, "--frames", ranges], stderr=subprocess.PIPE, text=True)
        for ranges in ("0-9", "10-23")
    ]
    for worker in workers:
        said = worker.communicate(timeout=280)[1]
        assert worker.returncode == 0, said
    upscale(shot, tmp_path / "whole", "--preroll", "2")
    assert images(tmp_path / "out") == images(tmp_path / "whole")


def test_ranges_of_one_folder_overlap_only_with_equal_settings(shot: Path, tmp_path: Path) -> None:
    upscale(shot, tmp_path, "--frames", "2-5", "--preroll", "1")
    before, images_before = files(tmp_path), images(tmp_path)
    for options in (("--method", "taau"), ("--method", "bilinear", "--scale", "1", "--overwrite")):
        message = refusal("upscale", shot, "-o", tmp_path, "--frames", "5-6", "--preroll", "1", *options)
        assert "images of another run are there" in message
        assert files(tmp_path) == before
    upscale(shot, tmp_path, "--frames", "5-6", "--preroll", "1")
    assert [*images(tmp_path)] == [f"{number:04d}.exr" for number in range(2, 7)]
    assert {name: images(tmp_path)[name] for name in before if name.endswith("exr")} == images_before
    upscale(shot, tmp_path, "--frames", "8", "--preroll", "1", method="taau")  # elsewhere, all may differ


def test_images_that_another_range_has_replaced_are_computed_again(shot: Path, tmp_path: Path) -> None:
    ranges = [("--frames", numbers, "--preroll", "1") for numbers in ("2-7", "5-8")]
    for name, options in zip("ab", ranges, strict=True):
        upscale(shot, tmp_path / name, *options, method="taau")
    assert images(tmp_path / "a")["0005.exr"] != images(tmp_path / "b")["0005.exr"]
    out = tmp_path / "out"
    for name, options in zip("abab", ranges * 2, strict=True):
        upscale(shot, out, *options, method="taau")
        assert images(out) | images(tmp_path / name) == images(out)
        assert "complete already" in upscale(shot, out, *options, method="taau").stderr


def test_overwriting_a_range_removes_no_file_of_another(shot: Path, tmp_path: Path) -> None:
    upscale(shot, tmp_path, "--frames", "2-3")
    before = files(tmp_path)
    upscale(shot, tmp_path, "--frames", "6-7")
    upscale(shot, tmp_path, "--frames", "6-7", "--format", "png", "--overwrite")
    after = files(tmp_path)
    assert [*images(tmp_path)] == ["0002.exr", "0003.exr", "0006.png", "0007.png"]
    assert {name: after[name] for name in before} == before


@pytest.mark.parametrize("options", [(), ("--overwrite",)])
@pytest.mark.parametrize("name", ["####", "v1####"])  # where a digit comes before the number, too
def test_only_temporary_files_of_its_own_frames_are_removed(
    shot: Path, tmp_path: Path, name: str, options: tuple[str, ...]
) -> None:
    upscale(shot, tmp_path, "--frames", "4-6", "--name", name)
    begin = name.removesuffix("####")
    for number in (5, 7, 12, 15):
        (tmp_path / f".{begin}{number:04d}.deadbeef.partial.exr").write_bytes(b"half")
    upscale(shot, tmp_path, "--frames", "4-6", "--name", name, *options)
    left = sorted(path.name for path in tmp_path.glob(".*"))
    assert left == [f".{begin}{number}.deadbeef.partial.exr" for number in ("0007", "0012", "0015")]


def test_a_page_and_a_video_of_a_range_are_called_by_its_numbers(shot: Path, tmp_path: Path) -> None:
    pytest.importorskip("av")
    options = ("--format", "mp4", "--compare", "--preroll", "1")
    upscale(shot, tmp_path, "--frames", "2-4", *options)
    upscale(shot, tmp_path, "--frames", "7", *options)
    label = "0002-0004"
    kinds = ("compare.{}.html", "upscale.{}.json", "video.{}.mp4")
    assert files(tmp_path).keys() == {kind.format(each) for kind in kinds for each in (label, "0007")}
    page = (tmp_path / f"compare.{label}.html").read_text(encoding="utf-8")
    assert '["frames", "3"]' in page
