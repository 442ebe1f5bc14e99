"""Tests of patterns as sources, of ranges of frames, and of the names of results that follow from them."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imported_scene import (
    CONVENTIONS,
    COUNT,
    CUT,
    JITTER,
    MAP,
    UNREAL_JITTER,
    arm_tensors,
    assert_is_the_scene,
    plane,
    write_blender,
    write_channels,
    write_safetensors,
)
from supersampler import ArgumentError, ShotError
from supersampler.io.images import write_exr
from supersampler.io.shot import Shot, copy_shot, import_channels, open_source
from supersampler.io.shot.format import LARGEST_NUMBER
from supersampler.io.shot.numbered import FrameRange
from upscale_runs import run, succeeded

FRAME = ("R", "G", "B", "Z", "motion.X", "motion.Y")


def write_frames(folder: Path, *names: str) -> Path:
    """Frames whose colour is the last number in their names."""
    for name in names:
        number = int("".join(character if character.isdigit() else " " for character in name).split()[-1])
        write_exr(folder / f"{name}.exr", {channel: plane(number, (8, 6)) for channel in FRAME})
    return folder


def numbers_of(shot: Shot) -> list[int]:
    """The numbers of the frames by their colour, which must be those that the shot says."""
    colors = [frame.color for frame in (shot.read(index).raw for index in range(len(shot)))]
    numbers = [int(color[0, 0, 0]) for color in colors if color is not None]
    assert numbers == list(range(shot.first_number, shot.first_number + len(shot)))
    return numbers


@pytest.mark.parametrize("pattern", ["kitchen_####.exr", "kitchen_%04d.exr", "kitchen_%d.exr", "k*_*.exr"])
def test_a_pattern_opens_blenders_frames(tmp_path: Path, pattern: str) -> None:
    write_blender(tmp_path, "V")
    write_exr(tmp_path / "beauty_0008.exr", {"R": plane(0)})
    assert_is_the_scene(open_source(tmp_path / pattern, cuts=[CUT]))


def test_a_pattern_opens_frames_with_a_channels_json(tmp_path: Path) -> None:
    write_channels(tmp_path)
    write_exr(tmp_path / "beauty.0000.exr", {"R": plane(0)})
    described = {"channels": MAP, "conventions": CONVENTIONS.to_json(), "frame_rate": 60, "cuts": [CUT]}
    (tmp_path / "channels.json").write_text(json.dumps(described))
    (tmp_path / "jitter.json").write_text(json.dumps(UNREAL_JITTER))
    shot = open_source(tmp_path / "####.exr")
    assert_is_the_scene(shot)
    assert shot.frame_rate == 60
    assert open_source(tmp_path / "####.exr", frame_rate=12).frame_rate == 12, "options replace its values"


@pytest.mark.parametrize(
    ("pattern", "numbers"),
    [
        ("a.####.exr", [9998, 9999, 10000]),
        ("a.%05d.exr", [10000]),
        ("a.%d.exr", [9998, 9999, 10000]),
        ("a.#.exr", [9998, 9999, 10000]),
        ("?.*.exr", [9998, 9999, 10000]),
    ],
)
def test_a_field_takes_its_digits_or_more(tmp_path: Path, pattern: str, numbers: list[int]) -> None:
    write_frames(tmp_path, "a.9998", "a.9999", "a.10000")
    assert numbers_of(open_source(tmp_path / pattern, conventions=CONVENTIONS)) == numbers


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        ("bauty.####.exr", r"has no file bauty\.####\.exr\. Did you mean beauty\.####\.exr \(10-12\)\?"),
        ("beauty.#####.exr", r"has no file .* Did you mean beauty\.####\.exr \(10-12\)\?"),
        ("##.####.exr", r"##\.####\.exr: has 2 fields for the frame number\. Keep one"),
        ("beauty.0010.exr", r"is one image; want a sequence\. Did you mean beauty\.####\.exr \(10-12\)\?"),
    ],
)
def test_a_wrong_pattern_is_answered_with_right_ones(tmp_path: Path, pattern: str, message: str) -> None:
    write_frames(tmp_path, "beauty.0010", "beauty.0011", "beauty.0012")
    with pytest.raises(ShotError, match=message):
        open_source(tmp_path / pattern, conventions=CONVENTIONS)


def test_a_map_whose_pattern_lacks_a_field_is_refused(tmp_path: Path) -> None:
    write_channels(tmp_path)
    with pytest.raises(ShotError, match=r"0000\.exr: has no field for the frame number\. Did you mean ####"):
        import_channels(tmp_path, {**MAP, "depth": "0000.exr:depth.V"}, conventions=CONVENTIONS)


def test_two_files_with_one_number_are_refused_with_the_patterns_that_part_them(tmp_path: Path) -> None:
    write_frames(tmp_path, "a.0001", "b.0001")
    message = r"b\.0001\.exr: has the same frame number as a\.0001\.exr\. .* a\.####\.exr \(1-1\) or b\."
    with pytest.raises(ShotError, match=message):
        open_source(tmp_path, conventions=CONVENTIONS)


def test_sequences_are_not_joined_even_if_all_their_numbers_differ(tmp_path: Path) -> None:
    write_frames(tmp_path, "a.0001", "a.0002", "b.0003", "b.0004")
    message = r"has files of several sequences \*\.exr\. .* a\.####\.exr \(1-2\) or b\.####\.exr \(3-4\)\."
    with pytest.raises(ShotError, match=message):
        open_source(tmp_path, conventions=CONVENTIONS)
    assert numbers_of(open_source(tmp_path / "b.*.exr", conventions=CONVENTIONS)) == [3, 4]


def test_a_pattern_is_not_opened_as_another_layout(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="path is a pattern; want a folder or file"):
        open_source(tmp_path / "####.exr", layout="shot")


def test_a_gap_counts_only_inside_of_the_range(tmp_path: Path) -> None:
    write_frames(tmp_path, "a.0010", "a.0011", "a.0012", "a.0020", "a.0021")

    def opened(first: int, last: int) -> list[int]:
        return numbers_of(open_source(tmp_path, conventions=CONVENTIONS, frames=(first, last)))

    assert opened(10, 12) == [10, 11, 12]
    assert opened(11, 12) == [11, 12]
    assert opened(20, 99) == [20, 21]
    assert opened(0, 10) == [10]
    with pytest.raises(ShotError, match=r"frame 13 to 15 between a\.0012\.exr and a\.0020\.exr is missing"):
        opened(10, 15)
    with pytest.raises(ShotError, match=r"has no frame from 22 to 30\. Its frames are 10 to 21"):
        opened(22, 30)
    with pytest.raises(ShotError, match="frame 13 to 19 between"):
        open_source(tmp_path, conventions=CONVENTIONS)


def test_jitter_and_cuts_count_from_the_first_file_whatever_the_range_is(tmp_path: Path) -> None:
    write_frames(tmp_path, *(f"a.{number:04d}" for number in range(10, 20)))
    jitter = [(0.0, 0.125), (0.25, 0.0), (0.5, 0.375)]
    whole = open_source(tmp_path, conventions=CONVENTIONS, jitter=jitter, cuts=[5])
    part = open_source(tmp_path, conventions=CONVENTIONS, jitter=jitter, cuts=[5], frames=(14, 17))
    for index in range(4):
        of_whole, of_part = whole.read_raw(index + 4), part.read_raw(index)
        assert (of_whole.jitter, of_whole.reset or index == 0) == (of_part.jitter, of_part.reset)
    assert [part.read_raw(index).reset for index in range(4)] == [True, True, False, False]


def test_a_range_of_every_layout_has_the_frames_of_the_whole(tmp_path: Path) -> None:
    blender = write_blender(tmp_path / "blender", "V")
    sources = {
        blender: 8,
        copy_shot(open_source(blender), tmp_path / "shot").path: 8,
        write_safetensors(tmp_path / "arm.safetensors", arm_tensors()): 0,
    }
    for path, first in sources.items():
        whole, part = open_source(path), open_source(path, frames=(first + 1, first + 9))
        assert (len(part), part.first_number) == (COUNT - 1, first + 1)
        assert part.reference_indices == [index - 1 for index in whole.reference_indices if index > 0]
        for index, item in enumerate(part):
            want = whole.read(index + 1)
            np.testing.assert_array_equal(item.frame.color, want.frame.color)
            np.testing.assert_array_equal(item.frame.motion, want.frame.motion)
            assert item.frame.jitter == want.frame.jitter == pytest.approx(JITTER)
            assert item.frame.reset == (want.frame.reset or index == 0)
            assert (item.reference is None) == (want.reference is None)
        with pytest.raises(ShotError, match=f"has no frame from 90 to 91. Its frames are {first} to"):
            open_source(path, frames=(90, 91))


def test_import_and_check_take_a_pattern_and_the_same_options(tmp_path: Path) -> None:
    write_frames(tmp_path / "renders", *(f"a.{number:04d}" for number in range(3)))
    source, out = str(tmp_path / "renders" / "a.####.exr"), str(tmp_path / "shot")
    done = run("import", source, "-o", out)
    assert "--conventions is left out; want given" in done.stderr
    assert "supersampler check" in done.stderr
    assert (done.exit_code, Path(out).exists()) == (2, False)
    done = run("check", source, "--conventions", "unreal", "--frames", "2")
    assert "3 frames" in done.stdout
    succeeded(run("import", source, "-o", out, "--conventions", "unreal"))
    assert Shot.open(out).info.file_names == "a.####"


# --- ranges of frame numbers, for numbers by chance ---


@st.composite
def ranges(draw: st.DrawFn, largest: int = 400) -> FrameRange:
    """Any range, of one number, too."""
    return FrameRange(*sorted((draw(st.integers(-largest, largest)), draw(st.integers(-largest, largest)))))


@given(ranges(LARGEST_NUMBER))
def test_the_text_of_a_range_is_parsed_to_the_same_range(numbers: FrameRange) -> None:
    assert FrameRange.parse(str(numbers), "--frames") == numbers
    assert FrameRange.parse(re.sub(r"(?<=\d)-", " - ", str(numbers)), "--frames") == numbers


@given(ranges(), ranges())
def test_a_range_has_its_numbers_and_overlaps_where_one_is_shared(one: FrameRange, other: FrameRange) -> None:
    numbers = {*range(one.first, one.last + 1)}
    assert len(one) == len(numbers)
    assert {n for n in range(-402, 402) if n in one} == numbers
    assert one.overlaps(other) == other.overlaps(one) == any(number in other for number in numbers)


@given(ranges(LARGEST_NUMBER), ranges(LARGEST_NUMBER))
def test_labels_of_different_ranges_differ(one: FrameRange, other: FrameRange) -> None:
    assert (one.label == other.label) == (one == other)
