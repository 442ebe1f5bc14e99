"""Tests of `open_source`: it detects each layout, and names what it found otherwise."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from imported_scene import (
    CONVENTIONS,
    CUT,
    MAP,
    UNREAL_JITTER,
    arm_tensors,
    assert_is_the_scene,
    assert_same_shot,
    plane,
    write_blender,
    write_channels,
    write_safetensors,
)
from supersampler import ArgumentError, ShotError
from supersampler.cli import app
from supersampler.io.images import write_exr
from supersampler.io.shot import (
    copy_shot,
    open_source,
)


def test_the_layout_is_guessed_from_what_is_there(tmp_path: Path) -> None:
    blender = open_source(write_blender(tmp_path / "blender", "V"), cuts=[CUT])
    channels = open_source(
        write_channels(tmp_path / "channels"), layout="channels", channel_map=MAP, conventions=CONVENTIONS,
        jitter=UNREAL_JITTER, cuts=[CUT],
    )  # fmt: skip
    arm = open_source(write_safetensors(tmp_path / "arm.safetensors", arm_tensors()))
    for shot in (blender, channels, arm):
        assert_is_the_scene(shot)
        copy_shot(shot, tmp_path / "copies" / shot.name)
        for path in (shot.name, f"{shot.name}/shot.json"):
            copy = open_source(tmp_path / "copies" / path)
            assert_is_the_scene(copy)
            assert_same_shot(copy, shot)


def test_what_cannot_be_guessed_is_answered_with_what_was_found(tmp_path: Path) -> None:
    with pytest.raises(ShotError, match=r"nowhere: there is no such file or folder\. Known are"):
        open_source(tmp_path / "nowhere")
    with pytest.raises(ShotError, match="holds nothing"):
        open_source(tmp_path)
    for index in range(10):
        (tmp_path / f"{index}.txt").write_text("")
    with pytest.raises(
        ShotError, match=r"holds 0\.txt, .*, 7\.txt and 2 more\. Known are a folder with shot\.json"
    ):
        open_source(tmp_path)
    with pytest.raises(ShotError, match="is neither a folder nor"):
        open_source(tmp_path / "0.txt")
    write_exr(tmp_path / "a_1.exr", {"R": plane(0), "Z": plane(1)})
    with pytest.raises(ShotError, match=r"holds frames with the channels R, Z\. A channels\.json says"):
        open_source(tmp_path)
    with pytest.raises(
        ArgumentError, match="layout is 'exr'; want 'auto', 'shot', 'render', 'blender', 'channels' or 'arm'"
    ):
        open_source(tmp_path, layout="exr")  # type: ignore[arg-type]


def test_an_option_that_the_layout_does_not_take_is_refused_by_name(tmp_path: Path) -> None:
    folder = write_blender(tmp_path / "blender", "V")
    with pytest.raises(ArgumentError, match="channel_map is given; want left out: the layout 'blender'"):
        open_source(folder, layout="blender", channel_map={})
    arm = write_safetensors(tmp_path / "arm.safetensors", arm_tensors())
    with pytest.raises(ArgumentError, match="frame_rate is given; want left out: the layout 'arm'"):
        open_source(arm, frame_rate=25.0)
    done = CliRunner().invoke(app, ["import", str(arm), "-o", str(tmp_path / "out"), "--frame-rate", "25"])
    assert "--frame-rate is given; want left out: the layout 'arm' does not use it" in done.stderr
    assert (done.exit_code, (tmp_path / "out").exists()) == (1, False)
