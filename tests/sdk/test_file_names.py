"""Tests of names of frames' files: signs, hyphens, brackets, wildcards and extensions in any case."""

from pathlib import Path

import numpy as np
import pytest

from supersampler import Conventions, ShotError
from supersampler.io.images import write_exr
from supersampler.io.shot import Shot, import_channels, open_source
from upscale_runs import files, upscale

FRAME = ("R", "G", "B", "Z", "motion.X", "motion.Y")
OURS = Conventions()


def write_frames(folder: Path, *names: str) -> Path:
    """Frames whose colour is 100 + their place in `names`."""
    for place, name in enumerate(names):
        values = np.full((6, 8), 100 + place, np.float32)
        write_exr(folder / "frame.exr", dict.fromkeys(FRAME, values))
        (folder / "frame.exr").rename(folder / name)
    return folder


def places_of(shot: Shot) -> list[int]:
    """The places in `names` of the frames of a shot, in its order."""
    colors = [shot.read_raw(index).color for index in range(len(shot))]
    return [int(color[0, 0, 0]) - 100 for color in colors if color is not None]


@pytest.mark.parametrize(
    ("names", "pattern"),
    [
        (("s.-0002.exr", "s.-0001.exr", "s.0000.exr", "s.0001.exr"), "s.####.exr"),
        (("s.-002.exr", "s.-001.exr", "s.0000.exr", "s.0001.exr"), "s.%04d.exr"),
        (("s.-2.exr", "s.-1.exr", "s.0000.exr", "s.0001.exr"), "s.####.exr"),
        (("s_-2.exr", "s_-1.exr", "s_0.exr", "s_1.exr"), "s_*.exr"),
        (("-0002.exr", "-0001.exr", "0000.exr", "0001.exr"), "####.exr"),
        (("-2.exr", "-1.exr", "0.exr", "1.exr"), "*.exr"),
    ],
)
def test_negative_numbers_are_in_order_of_time(tmp_path: Path, names: tuple[str, ...], pattern: str) -> None:
    write_frames(tmp_path, *names)
    for path in (tmp_path, tmp_path / pattern):
        shot = open_source(path, conventions=OURS)
        assert (places_of(shot), shot.first_number) == ([0, 1, 2, 3], -2)


def test_a_hyphen_that_every_name_has_separates(tmp_path: Path) -> None:
    write_frames(tmp_path, "s-0001.exr", "s-0002.exr", "s-0003.exr")
    for path in (tmp_path, tmp_path / "s-####.exr", tmp_path / "*####.exr"):
        shot = open_source(path, conventions=OURS)
        assert (places_of(shot), shot.first_number, shot.info.file_names) == ([0, 1, 2], 1, "s-####")


@pytest.mark.parametrize("pattern", ["", "s####.exr", "s*.exr", "*####.exr"])
def test_a_hyphen_that_may_be_a_sign_is_refused(tmp_path: Path, pattern: str) -> None:
    write_frames(tmp_path, "s-0001.exr", "s0000.exr", "s0001.exr")
    message = (
        r"s-0001\.exr: has an ambiguous hyphen, a sign or a separator: .* Name negative frames s\.-0001\.exr"
    )
    with pytest.raises(ShotError, match=message):
        open_source(tmp_path / pattern, conventions=OURS)


def test_a_pattern_without_the_hyphen_of_the_names_is_answered_with_it(tmp_path: Path) -> None:
    write_frames(tmp_path, "s-0001.exr", "s-0002.exr")
    with pytest.raises(ShotError, match=r"has no file s####\.exr\. Did you mean s-####\.exr \(1-2\)\?"):
        open_source(tmp_path / "s####.exr", conventions=OURS)


def test_results_have_the_negative_numbers_of_their_frames_and_runs_continue(
    tmp_path: Path,
) -> None:
    write_frames(tmp_path / "in", "s.-0002.exr", "s.-0001.exr", "s.0000.exr", "s.0001.exr")
    options = ("--conventions", "{}")
    upscale(tmp_path / "in", tmp_path / "out", *options)
    names = {"s.-0002.exr", "s.-0001.exr", "s.0000.exr", "s.0001.exr"}
    assert files(tmp_path / "out").keys() == {*names, "upscale.json"}
    assert "All 4 frames are complete already" in upscale(tmp_path / "in", tmp_path / "out", *options).stderr
    upscale(tmp_path / "in", tmp_path / "part", *options, "--frames=-2--1")
    assert files(tmp_path / "part").keys() == {"s.-0002.exr", "s.-0001.exr", "upscale.-002--001.json"}
    upscale(tmp_path / "in", tmp_path / "part", *options, "--frames", "0-1")
    assert files(tmp_path / "part").keys() >= names


@pytest.mark.parametrize("name", ["shot[v2]", "shot(1)", "take{a}", "a+b", "new^$"])
def test_brackets_and_the_like_in_a_pattern_are_text(tmp_path: Path, name: str) -> None:
    write_frames(tmp_path, f"{name}.0001.exr", f"{name}.0002.exr", "shot2.0001.exr")
    assert places_of(open_source(tmp_path / f"{name}.####.exr", conventions=OURS)) == [0, 1]
    assert places_of(open_source(tmp_path / f"{name}.*.exr", conventions=OURS)) == [0, 1]


@pytest.mark.parametrize("folder", ["a[1]", "w*", "which?", "n####", "%04d"])
def test_names_of_folders_are_text(tmp_path: Path, folder: str) -> None:
    write_frames(tmp_path / folder / folder, "s.0001.exr", "s.0002.exr")
    write_frames(tmp_path / "a1" / "a1", "s.0003.exr")
    write_frames(tmp_path / "which1" / "which1", "s.0003.exr")
    for path in (tmp_path / folder / folder, tmp_path / folder / folder / "s.####.exr"):
        assert places_of(open_source(path, conventions=OURS)) == [0, 1]
    channels = {"color": ["R", "G", "B"], "depth": "Z", "motion": ["motion.X", "motion.Y"]}
    mapped = {
        ours: [f"{folder}/s.*.exr:{name}" for name in ([names] if isinstance(names, str) else names)]
        for ours, names in channels.items()
    }
    assert places_of(import_channels(tmp_path / folder, mapped, conventions=OURS)) == [0, 1]


def test_an_extension_may_be_in_any_case(tmp_path: Path) -> None:
    write_frames(tmp_path, "s.0001.EXR", "s.0002.Exr", "s.0003.exr")
    for path in (tmp_path, tmp_path / "s.####.exr", tmp_path / "s.*.EXR"):
        assert places_of(open_source(path, conventions=OURS)) == [0, 1, 2]
    mapped = {"color": ["R", "G", "B"], "depth": "S.####.EXR:Z", "motion": ["motion.X", "motion.Y"]}
    with pytest.raises(ShotError, match=r"has no file S\.####\.EXR"):  # only the extension
        import_channels(tmp_path, mapped, conventions=OURS)


def test_metadata_of_a_file_with_a_large_extension_is_kept(tmp_path: Path) -> None:
    channels = {name: np.ones((6, 8), np.float32) for name in FRAME}
    write_exr(tmp_path / "s.0001.exr", channels, metadata={"comments": "night"})
    (tmp_path / "s.0001.exr").rename(tmp_path / "s.0001.EXR")
    assert open_source(tmp_path, conventions=OURS).read_metadata(0)["ImageDescription"] == "night"


def test_two_files_whose_extensions_differ_in_case_only_are_refused(tmp_path: Path) -> None:
    write_frames(tmp_path, "s.0001.EXR", "s.0001.exr")
    with pytest.raises(ShotError, match=r"same frame number as s\.0001\.EXR\. Move one of the two away"):
        open_source(tmp_path / "s.####.exr", conventions=OURS)
