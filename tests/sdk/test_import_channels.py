"""Tests of `import_channels`: signs, units and order of the imported frames."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imported_scene import (
    CONVENTIONS,
    COUNT,
    CUT,
    DISPLAY_SIZE,
    JITTER,
    MAP,
    NEAR,
    PAST,
    UNREAL_JITTER,
    assert_is_the_scene,
    assert_same_shot,
    plane,
    truth,
    write_channels,
)
from supersampler import ArgumentError, ShotError
from supersampler.conventions import Conventions
from supersampler.io.images import write_exr
from supersampler.io.shot import (
    copy_shot,
    import_channels,
    open_source,
)


def test_a_channel_map_reads_anybodys_files(tmp_path: Path) -> None:
    write_channels(tmp_path)
    shot = import_channels(
        tmp_path,
        {**MAP, "roughness": "rough"},
        conventions=CONVENTIONS,
        jitter=UNREAL_JITTER,
        cuts=[CUT],
        name="ue",
    )
    assert_is_the_scene(shot)
    assert (shot.name, shot.conventions) == ("ue", CONVENTIONS)
    gbuffer = shot.read(2).frame.gbuffer
    assert gbuffer is not None
    assert (gbuffer["roughness"] == np.float32(0.3)).all()


def test_the_map_can_lie_in_the_folder(tmp_path: Path) -> None:
    write_channels(tmp_path)
    described = {"channels": MAP, "conventions": CONVENTIONS.to_json(), "frame_rate": 60, "cuts": [CUT]}
    (tmp_path / "channels.json").write_text(json.dumps(described))
    (tmp_path / "jitter.json").write_text(json.dumps(UNREAL_JITTER))
    shot = open_source(tmp_path)
    assert_is_the_scene(shot)
    assert shot.frame_rate == 60


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"conventions": {"depth": "deep"}}, r"channels\.json: is not valid: depth is 'deep'; want"),
        (
            {"channels": {"color": ["R"]}},
            r"channels\.json: is not valid: channel_map\['color'\] is \['R'\]; want 3",
        ),
        ({"channels": {"color": 3}}, r"channel_map\['color'\] is 3; want 3 channel names"),
        ({"channel": {}}, r"channels\.json: the file has the unknown key 'channel'"),
        ({"cuts": ["a"]}, r"channels\.json: is not valid: cuts is \['a'\]; want indices of frames, 0 to 0"),
    ],
)
def test_a_wrong_map_in_the_folder_is_named(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    write_channels(tmp_path, 1)
    described = {"channels": MAP, "conventions": {}, **change}
    (tmp_path / "channels.json").write_text(json.dumps(described))
    with pytest.raises(ShotError, match=message):
        open_source(tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"colour": "R"},
            "is a map with 'colour'; want one of color, depth, motion, motion_next, base_color",
        ),
        ({"motion": "X"}, r"channel_map\['motion'\] is 'X'; want 2 channel names"),
        (
            {"motion": ["X", "motion/*.exr:Y"]},
            r"is files of \*\.exr and motion/\*\.exr; want channels of one file",
        ),
        ({"depth": None}, "is a map without 'depth'; want depth and motion at least"),
    ],
)
def test_a_wrong_map_is_named(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    write_channels(tmp_path, 1)
    channel_map = {name: value for name, value in {**MAP, **change}.items() if value is not None}
    with pytest.raises(ArgumentError, match=message):
        import_channels(tmp_path, channel_map, conventions=CONVENTIONS)


def test_a_missing_channel_is_named_with_those_that_are_there(tmp_path: Path) -> None:
    write_channels(tmp_path, 1)
    with pytest.raises(ShotError, match=r"0000\.exr: has no channel Z\. It has R, G, B, rough, depth\.V"):
        import_channels(tmp_path, {**MAP, "depth": "Z"}, conventions=CONVENTIONS)


def test_a_gap_in_the_numbers_is_an_error(tmp_path: Path) -> None:
    write_channels(tmp_path, 5)
    (tmp_path / "0002.exr").unlink()
    with pytest.raises(ShotError, match=r"frame 2 between 0001\.exr and 0003\.exr is missing"):
        import_channels(tmp_path, MAP, conventions=CONVENTIONS)


def test_files_that_do_not_pair_up_are_named(tmp_path: Path) -> None:
    write_channels(tmp_path)
    (tmp_path / "motion" / "0002.exr").unlink()
    with pytest.raises(ShotError, match=r"frame 2 is among \*\.exr and not among motion/\*\.exr"):
        import_channels(tmp_path, MAP, conventions=CONVENTIONS)


def test_two_sequences_in_one_folder_are_told_apart_by_a_pattern(tmp_path: Path) -> None:
    write_channels(tmp_path)
    write_exr(tmp_path / "preview_0001.exr", {"Z": plane(0)})
    with pytest.raises(
        ShotError, match=r"has the same frame number as 0001\.exr. Choose one sequence by a pattern"
    ):
        import_channels(tmp_path, MAP, conventions=CONVENTIONS)


def test_a_frame_of_another_size_is_named(tmp_path: Path) -> None:
    write_channels(tmp_path)
    write_exr(tmp_path / "0001.exr", {name: plane(0, (8, 8)) for name in ("R", "G", "B", "depth.V")})
    shot = import_channels(tmp_path, MAP, conventions=CONVENTIONS)
    with pytest.raises(ShotError, match=r"0001\.exr: is 8x8; the shot says 64x36"):
        shot.read(1)


def test_references_of_other_numbers_are_refused(tmp_path: Path) -> None:
    write_channels(tmp_path)
    write_exr(tmp_path / "best" / "0003.exr", truth(0))
    channel_map = {**MAP, "reference": [f"best/*.exr:{axis}" for axis in "RGB"]}
    with pytest.raises(ShotError, match=r"no reference best/\*\.exr has the number of a frame, 0 to 2"):
        import_channels(tmp_path, channel_map, conventions=CONVENTIONS)
    write_exr(tmp_path / "best" / "0001.exr", truth(1))
    shot = import_channels(tmp_path, channel_map, conventions=CONVENTIONS)
    assert (shot.reference_indices, shot.display_size) == ([1], DISPLAY_SIZE)


def test_motion_of_display_size_is_read_from_its_own_file(tmp_path: Path) -> None:
    write_channels(tmp_path)
    for index in range(COUNT):
        motion = {"R": plane(2 * PAST[0], DISPLAY_SIZE), "G": plane(2 * PAST[1], DISPLAY_SIZE)}
        write_exr(tmp_path / "motion" / f"{index:04d}.exr", motion)
    conventions = Conventions(depth="linear", near=NEAR, motion_resolution="display")
    shot = import_channels(
        tmp_path, MAP, conventions=conventions, jitter=[JITTER] * COUNT, cuts=[CUT], display_size=DISPLAY_SIZE
    )
    assert_is_the_scene(shot)
    copy = copy_shot(shot, tmp_path.with_name(f"{tmp_path.name} copy"))
    assert_is_the_scene(copy)
    assert_same_shot(copy, shot)
