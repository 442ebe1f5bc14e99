"""Tests of patterns as sources, of ranges of frames, and of the names of results that follow from them."""

import json
import re
from pathlib import Path
from typing import Any

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
from supersampler.io.shot.numbered import FrameRange, numbered_files
from upscale_runs import files, run, succeeded, upscale

FRAME = ("R", "G", "B", "Z", "motion.X", "motion.Y")


def write_frames(folder: Path, *names: str) -> Path:
    """Frames whose colour is 100 + their place in `names`."""
    for place, name in enumerate(names):
        write_exr(folder / "frame.exr", dict.fromkeys(FRAME, plane(100 + place, (8, 6))))
        (folder / "frame.exr").rename(folder / name)
    return folder


def places_of(shot: Shot) -> list[int]:
    """The places in `names` of the frames of a shot, in its order."""
    colors = [shot.read_raw(index).color for index in range(len(shot))]
    return [int(color[0, 0, 0]) - 100 for color in colors if color is not None]


def opened(path: Path, **options: Any) -> list[int]:
    """Open frames in the tests' conventions; return their places."""
    return places_of(open_source(path, conventions=CONVENTIONS, **options))


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
    ("pattern", "places"),
    [
        ("a.####.exr", [0, 1, 2]), ("a.%04d.exr", [0, 1, 2]), ("a.%d.exr", [0, 1, 2]), ("a.#.exr", [0, 1, 2]),
        ("?.*.exr", [0, 1, 2]),
    ],
)  # fmt: skip
def test_a_field_takes_its_digits_or_more(tmp_path: Path, pattern: str, places: list[int]) -> None:
    write_frames(tmp_path, "a.9998.exr", "a.9999.exr", "a.10000.exr")
    assert opened(tmp_path / pattern) == places


@pytest.mark.parametrize("pattern", ["a.####.exr", "a.%04d.exr"])
def test_a_field_of_more_digits_than_earlier_frames_have_is_refused(tmp_path: Path, pattern: str) -> None:
    write_frames(tmp_path, "a.998.exr", "a.999.exr", "a.1000.exr", "a.1001.exr")
    message = (
        r"has a\.999\.exr, too, whose number has fewer digits than a\..* Take any number of digits: a\.#"
    )
    with pytest.raises(ShotError, match=message):
        opened(tmp_path / pattern)
    assert opened(tmp_path / "a.#.exr") == [0, 1, 2, 3]
    (tmp_path / "a.999.exr").unlink()
    assert opened(tmp_path / pattern) == [2, 3]


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        ("bauty.####.exr", r"has no file bauty\.####\.exr\. Did you mean beauty\.####\.exr \(10-12\)\?"),
        ("beauty.#####.exr", r"has no file .* Did you mean beauty\.####\.exr \(10-12\)\?"),
        ("##.####.exr", r"##\.####\.exr: has 2 fields for the frame number\. Keep one"),
        ("beauty.$F4.exr", r"no such file or folder\. Did you mean beauty\.####\.exr \(10-12\)\?"),
        ("beauty.0010.exr", r"is one image; want a sequence\. Did you mean beauty\.####\.exr \(10-12\)\?"),
    ],
)
def test_a_wrong_pattern_is_answered_with_right_ones(tmp_path: Path, pattern: str, message: str) -> None:
    write_frames(tmp_path, "beauty.0010.exr", "beauty.0011.exr", "beauty.0012.exr")
    with pytest.raises(ShotError, match=message):
        opened(tmp_path / pattern)


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        ("shots/ref/*.exr", r"has no file shots/ref/\*\.exr\. The pattern is relative to .*in\."),
        ("ref/#.exr", r"has no file ref/#\.exr\. Did you mean ref/a\.####\.exr \(10-10\)\?"),
        (r"ref\*.exr", r"has no file ref.\*\.exr\. Patterns have forward slashes: ref/\*\.exr\."),
        ("ref", r"in/ref: has no field for the frame number\. Name its files: ref/\*\.exr\."),
    ],
)
def test_a_wrong_pattern_of_references_is_answered_with_right_ones(
    tmp_path: Path, pattern: str, message: str
) -> None:
    write_frames(tmp_path / "in", "beauty.0010.exr")
    write_frames(tmp_path / "in" / "ref", "a.0010.exr")
    with pytest.raises(ShotError, match=message):
        open_source(tmp_path / "in", conventions=CONVENTIONS, reference=pattern)


def test_a_map_whose_pattern_lacks_a_field_is_refused(tmp_path: Path) -> None:
    write_channels(tmp_path)
    with pytest.raises(ShotError, match=r"0000\.exr: has no field for the frame number\. Did you mean ####"):
        import_channels(tmp_path, {**MAP, "depth": "0000.exr:depth.V"}, conventions=CONVENTIONS)


def test_two_files_with_one_number_are_refused_with_the_patterns_that_part_them(tmp_path: Path) -> None:
    write_frames(tmp_path, "a.0001.exr", "b.0001.exr")
    message = r"b\.0001\.exr: has the same frame number as a\.0001\.exr\. .* a\.####\.exr \(1-1\) or b\."
    with pytest.raises(ShotError, match=message):
        opened(tmp_path)


def test_a_sequence_with_a_later_number_in_its_names_is_answered_with_its_pattern(tmp_path: Path) -> None:
    write_frames(tmp_path, "a-0001_v2.exr", "a-0002_v2.exr")
    with pytest.raises(
        ShotError, match=r"has the same frame number .* by a pattern: a-####_v2\.exr \(1-2\)\."
    ):
        open_source(tmp_path, conventions=CONVENTIONS)
    assert len(open_source(tmp_path / "a-####_v2.exr", conventions=CONVENTIONS)) == 2


def test_sequences_are_not_joined_even_if_all_their_numbers_differ(tmp_path: Path) -> None:
    write_frames(tmp_path, "a.0001.exr", "a.0002.exr", "b.0003.exr", "b.0004.exr")
    message = r"has files of several sequences \*\.exr\. .* a\.####\.exr \(1-2\) or b\.####\.exr \(3-4\)\."
    with pytest.raises(ShotError, match=message):
        opened(tmp_path)
    assert opened(tmp_path / "b.*.exr") == [2, 3]


def test_a_number_that_is_too_large_for_names_is_refused(tmp_path: Path) -> None:
    write_frames(tmp_path, "s.20260101000001.exr")
    with pytest.raises(
        ShotError, match=r"has the frame number 20260101000001; want at most .* Choose digits"
    ):
        open_source(tmp_path, conventions=CONVENTIONS)
    assert open_source(tmp_path / "s.20260101######.exr", conventions=CONVENTIONS).first_number == 1


def test_a_pattern_is_not_opened_as_another_layout(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="path is a pattern; want a folder or file"):
        open_source(tmp_path / "####.exr", layout="shot")


def test_a_gap_counts_only_inside_of_the_range(tmp_path: Path) -> None:
    write_frames(tmp_path, *(f"a.{number:04d}.exr" for number in (10, 11, 12, 20, 21)))
    for frames, places in (((10, 12), [0, 1, 2]), ((11, 12), [1, 2]), ((20, 99), [3, 4]), ((0, 10), [0])):
        shot = open_source(tmp_path, conventions=CONVENTIONS, frames=frames)
        assert (places_of(shot), shot.first_number) == (places, max(10, frames[0]))
    with pytest.raises(ShotError, match=r"frame 13 to 15 between a\.0012\.exr and a\.0020\.exr is missing"):
        opened(tmp_path, frames=(10, 15))
    with pytest.raises(ShotError, match=r"has no frame from 22 to 30\. Its frames are 10 to 21"):
        opened(tmp_path, frames=(22, 30))
    with pytest.raises(ShotError, match="frame 13 to 19 between"):
        opened(tmp_path)


def test_jitter_and_cuts_count_from_the_first_file_whatever_the_range_is(tmp_path: Path) -> None:
    write_frames(tmp_path, *(f"a.{number:04d}.exr" for number in range(10, 20)))
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
    write_frames(tmp_path / "renders", *(f"a.{number:04d}.exr" for number in range(3)))
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


# --- names of files: signs, hyphens, brackets, wildcards, extensions in any case ---


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
        shot = open_source(path, conventions=CONVENTIONS)
        assert (places_of(shot), shot.first_number) == ([0, 1, 2, 3], -2)


def test_a_hyphen_that_every_name_has_separates(tmp_path: Path) -> None:
    write_frames(tmp_path, "s-0001.exr", "s-0002.exr", "s-0003.exr")
    for path in (tmp_path, tmp_path / "s-####.exr", tmp_path / "*####.exr"):
        shot = open_source(path, conventions=CONVENTIONS)
        assert (places_of(shot), shot.first_number, shot.info.file_names) == ([0, 1, 2], 1, "s-####")


@pytest.mark.parametrize("pattern", ["", "s####.exr", "s*.exr", "*####.exr"])
def test_a_hyphen_that_may_be_a_sign_is_refused(tmp_path: Path, pattern: str) -> None:
    write_frames(tmp_path, "s-0001.exr", "s0000.exr", "s0001.exr")
    message = r"s-0001\.exr: has an ambiguous hyphen, .*: .* Name negative frames s\.-0001\.exr"
    with pytest.raises(ShotError, match=message):
        opened(tmp_path / pattern)


def test_a_pattern_without_the_hyphen_of_the_names_is_answered_with_it(tmp_path: Path) -> None:
    write_frames(tmp_path, "s-0001.exr", "s-0002.exr")
    with pytest.raises(ShotError, match=r"has no file s####\.exr\. Did you mean s-####\.exr \(1-2\)\?"):
        opened(tmp_path / "s####.exr")


def test_results_have_the_negative_numbers_of_their_frames_and_runs_continue(tmp_path: Path) -> None:
    names = {"s.-0002.exr", "s.-0001.exr", "s.0000.exr", "s.0001.exr"}
    write_frames(tmp_path / "in", *sorted(names))
    options = ("--conventions", "{}")
    upscale(tmp_path / "in", tmp_path / "out", *options)
    assert files(tmp_path / "out").keys() == {*names, "upscale.json"}
    assert "All 4 frames are complete already" in upscale(tmp_path / "in", tmp_path / "out", *options).stderr
    upscale(tmp_path / "in", tmp_path / "part", *options, "--frames=-2--1")
    assert files(tmp_path / "part").keys() == {"s.-0002.exr", "s.-0001.exr", "upscale.-002--001.json"}
    upscale(tmp_path / "in", tmp_path / "part", *options, "--frames", "0-1")
    assert files(tmp_path / "part").keys() >= names


@pytest.mark.parametrize("name", ["shot[v2]", "shot(1)", "take{a}", "a+b", "new^$"])
def test_brackets_and_the_like_in_a_pattern_are_text(tmp_path: Path, name: str) -> None:
    write_frames(tmp_path, f"{name}.0001.exr", f"{name}.0002.exr", "shot2.0001.exr")
    assert opened(tmp_path / f"{name}.####.exr") == [0, 1]
    assert opened(tmp_path / f"{name}.*.exr") == [0, 1]


@pytest.mark.parametrize("folder", ["a[1]", "w*", "which?", "n####", "%04d"])
def test_names_of_folders_are_text(tmp_path: Path, folder: str) -> None:
    write_frames(tmp_path / folder / folder, "s.0001.exr", "s.0002.exr")
    for other in ("a1", "which1"):
        write_frames(tmp_path / other / other, "s.0003.exr")
    for path in (tmp_path / folder / folder, tmp_path / folder / folder / "s.####.exr"):
        assert opened(path) == [0, 1]
    groups = {"color": FRAME[:3], "depth": FRAME[3:4], "motion": FRAME[4:]}
    mapped = {ours: [f"{folder}/s.*.exr:{name}" for name in names] for ours, names in groups.items()}
    assert places_of(import_channels(tmp_path / folder, mapped, conventions=CONVENTIONS)) == [0, 1]


def test_an_extension_may_be_in_any_case(tmp_path: Path) -> None:
    write_frames(tmp_path, "s.0001.EXR", "s.0002.Exr", "s.0003.exr")
    for path in (tmp_path, tmp_path / "s.####.exr", tmp_path / "s.*.EXR"):
        assert opened(path) == [0, 1, 2]
    mapped = {"color": ["R", "G", "B"], "depth": "S.####.EXR:Z", "motion": ["motion.X", "motion.Y"]}
    with pytest.raises(ShotError, match=r"has no file S\.####\.EXR"):  # only the extension
        import_channels(tmp_path, mapped, conventions=CONVENTIONS)


def test_metadata_of_a_file_with_a_large_extension_is_kept(tmp_path: Path) -> None:
    channels = {name: np.ones((6, 8), np.float32) for name in FRAME}
    write_exr(tmp_path / "s.0001.exr", channels, metadata={"comments": "night"})
    (tmp_path / "s.0001.exr").rename(tmp_path / "s.0001.EXR")
    assert open_source(tmp_path, conventions=CONVENTIONS).read_metadata(0)["ImageDescription"] == "night"


@pytest.mark.parametrize("names", [("s.0001.EXR", "s.0001.exr"), ("s.0001.exr", "s.1.exr")])
def test_two_files_of_one_number_that_no_pattern_parts_are_refused(
    tmp_path: Path, names: tuple[str, str]
) -> None:
    write_frames(tmp_path, *names)
    with pytest.raises(ShotError, match=rf"same frame number as {names[0]}\. Move one of the two away"):
        opened(tmp_path / "s.#.exr")


def test_no_pattern_takes_long(tmp_path: Path) -> None:
    write_frames(tmp_path, f"{'s' * 200}.0001.exr")
    many = "*s?" * 20
    for pattern in (f"{many}x.exr", f"{many}.####*x*.exr"):
        with pytest.raises(ShotError, match="has no file"):
            numbered_files(tmp_path, pattern)
    assert [*numbered_files(tmp_path, f"{many}*.####.exr")] == [1]


@pytest.mark.parametrize("layout", ["pattern", "map", "blender"])
def test_links_out_of_the_folder_are_read_only_if_the_user_says_so(tmp_path: Path, layout: str) -> None:
    store, folder = tmp_path / "store", tmp_path / "published"
    (write_blender(store, "V") if layout == "blender" else write_channels(store))
    folder.mkdir()
    for path in store.glob("*.exr"):
        (folder / path.name.replace("_", ".")).symlink_to(path)
    others = "motion", "reference", "jitter.json"
    for name in (each for each in others if (store / each).exists()):
        (folder / name).symlink_to(store / name)
    described = {"channels": MAP, "conventions": CONVENTIONS.to_json(), "cuts": [CUT]}
    if layout == "map":
        (folder / "channels.json").write_text(json.dumps(described))
    by_layout: dict[str, dict[str, Any]] = {
        "pattern": {"channel_map": MAP, "conventions": CONVENTIONS, "layout": "channels"},
        "blender": {"reference": "reference/*.exr"},
        "map": {},
    }
    options = by_layout[layout]
    path = folder / "####.exr" if layout == "pattern" else folder
    jitter = UNREAL_JITTER if layout != "blender" else [JITTER]
    with pytest.raises(ShotError, match=r"leads out of .* --follow-links .* reads them"):
        open_source(path, jitter=jitter, **options)
    shot = open_source(path, jitter=jitter, cuts=[CUT], follow_links=True, **options)
    assert_is_the_scene(shot)
    assert shot.source == folder
    if layout == "map":
        result = succeeded(run("info", folder, "--follow-links"))
        assert "frames        3" in result.output
        (folder / "channels.json").write_text(json.dumps({**described, "follow_links": True}))
        with pytest.raises(ShotError, match="unknown field `follow_links`"):
            open_source(folder)


def test_a_link_to_another_file_than_an_image_is_refused_even_where_links_are_followed(
    tmp_path: Path,
) -> None:
    write_frames(tmp_path / "in", "a.0001.exr")
    (tmp_path / "key").write_text("-----BEGIN PRIVATE KEY-----")
    (tmp_path / "in/a.0002.exr").symlink_to(tmp_path / "key")
    shot = open_source(tmp_path / "in", conventions=CONVENTIONS, follow_links=True)
    with pytest.raises(ShotError, match=r"a\.0002\.exr: is not an EXR") as caught:
        shot.read(1)
    assert "PRIVATE" not in str(caught.value)
