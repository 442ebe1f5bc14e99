"""Tests of `supersampler blender` with a recorded render: resuming, errors, frames upscaled meanwhile."""

import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from blender_files import RECORDED, fake_blender, scene_file
from supersampler import ArgumentError
from supersampler.cli import app
from supersampler.integrations.blender.render import find_blender
from supersampler.io.images import read_exr, read_header
from supersampler.io.shot import open_source
from supersampler.io.shot.numbered import FrameRange
from supersampler.upscaler import Upscaler

METHOD = ("--method", "bilinear")
IMAGES = ["0005.exr", "0006.exr", "0007.exr", "0008.exr"]


def blender(folder: Path, *options: object, program: object = None, **plan: Any) -> Result:
    """Run the command on a scene of this plan, into folder/out."""
    program = program or fake_blender(folder)
    command = ["blender", scene_file(folder, **plan), "-o", folder / "out", *METHOD, "--blender", program]
    return CliRunner().invoke(app, [str(word) for word in (*command, *options)])


def one_line(result: Result) -> str:
    """The last line, once it is sure that it is the only error."""
    assert result.exit_code == 1, result.output
    lines = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1
    return str(lines[0])


def images(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted((folder / "out").glob("*.exr"))}


def rendered(folder: Path) -> list[int]:
    """Numbers of the frames that Blender rendered in the last run."""
    log = (folder / "out" / "render" / "blender.log").read_text()
    return [int(number) for number in re.findall(r"^Fra:(\d+)", log, re.MULTILINE)]


def test_images_have_blenders_numbers_and_are_those_of_the_rendered_shot(tmp_path: Path) -> None:
    done = blender(tmp_path)
    assert done.exit_code == 0, done.output
    assert list(images(tmp_path)) == IMAGES
    assert "motion blur is off" in done.stderr
    upscaler = Upscaler("bilinear", display_size=(96, 64))
    for item, name in zip(open_source(RECORDED), IMAGES, strict=True):
        channels = read_exr(tmp_path / "out" / name)
        assert channels.keys() == {"R", "G", "B", "A"}
        image = np.stack([channels[axis] for axis in "RGB"], axis=-1)
        np.testing.assert_array_equal(image, upscaler.step(item.frame).astype(np.float16))


def test_metadata_of_blenders_frames_is_kept_but_what_is_of_their_layout(tmp_path: Path) -> None:
    blender(tmp_path)
    metadata = read_header(tmp_path / "out" / "0006.exr").metadata
    assert metadata.items() >= {"Camera": "Camera", "Frame": "6", "Scene": "Scene"}.items()
    stated = {name: metadata.pop(name) for name in ("chromaticities", "colorInteropID")}
    assert stated["colorInteropID"] == "lin_rec709_scene"
    assert metadata == read_header(RECORDED / "0006.exr").metadata
    assert "BlenderMultiChannel" not in metadata  # the results are no multilayer files


def test_a_frame_is_upscaled_while_the_next_ones_render(tmp_path: Path) -> None:
    waits = {"wait_at": 8, "for": str(tmp_path / "out" / "0005.exr")}
    done = blender(tmp_path, **waits)
    assert done.exit_code == 0, done.output
    assert list(images(tmp_path)) == IMAGES


@pytest.mark.parametrize("how", ["error_at", "crash_at"])
def test_a_render_that_fails_keeps_its_frames_and_continues_to_the_same_images(
    tmp_path: Path, how: str
) -> None:
    (tmp_path / "whole").mkdir()
    blender(tmp_path / "whole")
    line = one_line(blender(tmp_path, **{how: 7}))
    assert "scene.blend: the render ended after 2 frames: " in line
    assert ("Error: out of memory" if how == "error_at" else "ended with SIGABRT") in line
    assert line.endswith("blender.log.")
    assert list(images(tmp_path)) == IMAGES[:2]
    assert blender(tmp_path).exit_code == 0
    assert rendered(tmp_path) == [7, 8]
    assert images(tmp_path) == images(tmp_path / "whole")


def test_more_frames_may_follow_and_a_complete_render_needs_no_blender(tmp_path: Path) -> None:
    blender(tmp_path, "--frames", "5-6")
    assert blender(tmp_path, "--frames", "5-8").exit_code == 0
    assert rendered(tmp_path) == [7, 8]
    again = blender(tmp_path, "--frames", "5-8", program="nowhere")
    assert "All 4 frames are there already" in again.stderr
    assert again.exit_code == 0
    (tmp_path / "out" / "render" / "0006.exr").unlink()
    (tmp_path / "out" / "0007.exr").unlink()
    assert blender(tmp_path).exit_code == 0
    assert rendered(tmp_path) == [6, 7, 8]
    assert list(images(tmp_path)) == IMAGES


def test_a_render_that_has_completed_no_frame_is_in_the_way_of_no_other(tmp_path: Path) -> None:
    assert "no camera" in one_line(blender(tmp_path, "--camera", "Other", error="no camera is named 'Other'"))
    assert blender(tmp_path, "--camera", "Camera").exit_code == 0
    assert list(images(tmp_path)) == IMAGES


def test_frames_of_another_request_are_refused_until_overwritten(tmp_path: Path) -> None:
    blender(tmp_path)
    before = images(tmp_path)
    assert "samples was None, is now 4" in one_line(blender(tmp_path, "--samples", 4))
    assert "begins with 6" in one_line(blender(tmp_path, "--frames", "6-8"))
    program = fake_blender(tmp_path)
    scene_file(tmp_path).write_text("BLENDER with a change")
    command = ["blender", tmp_path / "scene.blend", "-o", tmp_path / "out", *METHOD, "--blender", program]
    changed = CliRunner().invoke(app, [str(word) for word in command])
    assert "frames of another render are there: the file has changed" in one_line(changed)
    assert images(tmp_path) == before
    assert blender(tmp_path, "--frames", "6-8", "--overwrite").exit_code == 0
    assert list(images(tmp_path)) == IMAGES[1:]
    assert sorted(path.name for path in (tmp_path / "out" / "render").glob("*.exr")) == IMAGES[1:]


@pytest.mark.parametrize("name", ["out/0006.exr", "out/render/0006.exr"])
@pytest.mark.parametrize("options", [(), ("--overwrite",)])
def test_a_file_of_others_in_the_way_is_named_and_kept(
    tmp_path: Path, name: str, options: tuple[str, ...]
) -> None:
    path = tmp_path / name
    path.parent.mkdir(parents=True)
    path.write_bytes(b"mine")
    line = one_line(blender(tmp_path, *options))
    assert f"{path}: is there already" in line
    assert "does not list it" in line
    assert path.read_bytes() == b"mine"


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        (
            {"error": "scene 'Scene' has no active camera: add one"},
            "the render ended before the first frame: scene 'Scene' has no active camera: add one",
        ),
        (
            {"crash": True},
            "the render ended before the first frame: Blender ended with SIGABRT: Writing: /tmp/",
        ),
    ],
)
def test_what_blender_says_of_a_scene_is_one_line(tmp_path: Path, plan: dict[str, Any], message: str) -> None:
    assert message in one_line(blender(tmp_path, **plan))


def test_a_program_that_is_no_blender_is_named(tmp_path: Path) -> None:
    line = one_line(blender(tmp_path, program=sys.executable))
    assert f"{sys.executable} is not Blender, and cannot import bpy" in line
    assert "--blender is nowhere, which is not a program" in one_line(blender(tmp_path, program="nowhere"))
    other = fake_blender(tmp_path)
    other.write_text("#!/bin/sh\n")
    assert "before the first frame: Blender ended with code 0" in one_line(blender(tmp_path, program=other))


OCIO = """
ocio_profile_version: 2
roles: {scene_linear: linear, default: linear}
file_rules: [!<Rule> {name: Default, colorspace: default}]
displays: {sRGB: [!<View> {name: AgX, colorspace: linear}]}
colorspaces: [!<ColorSpace> {name: linear}]
"""


@pytest.fixture
def view(tmp_path: Path) -> dict[str, dict[str, str]]:
    """The plan of a scene that can be shown."""
    path = tmp_path / "config.ocio"
    path.write_text(OCIO)
    return {"scene": {"ocio": str(path)}}


def test_a_view_that_is_missing_is_one_line_before_the_first_result(
    tmp_path: Path, view: dict[str, dict[str, str]]
) -> None:
    Path(view["scene"]["ocio"]).write_text(OCIO.replace("name: AgX", "name: Filmic"))
    assert "view is 'AgX'; want one of Filmic" in one_line(blender(tmp_path, "--format", "png", **view))
    assert not list((tmp_path / "out").glob("*.png"))
    Path(view["scene"]["ocio"]).write_text(OCIO)
    done = blender(tmp_path, "--format", "png", **view)
    assert done.exit_code == 0, done.output
    assert len(list((tmp_path / "out").glob("*.png"))) == 4


def test_a_locked_scene_and_a_folder_that_cannot_be_written_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "out").write_bytes(b"no folder")
    assert "out/render: cannot be written" in one_line(blender(tmp_path))
    path_open = Path.open

    def locked(path: Path, *arguments: Any, **options: Any) -> Any:  # root may read everything
        if path.name == "scene.blend" and "w" not in arguments:
            raise PermissionError(13, "Permission denied")
        return path_open(path, *arguments, **options)

    scene_file(tmp_path)
    monkeypatch.setattr(Path, "open", locked)
    command = ["blender", tmp_path / "scene.blend", "-o", tmp_path / "other", "--blender", sys.executable]
    line = one_line(CliRunner().invoke(app, [str(word) for word in command]))
    assert "scene.blend: cannot be read ([Errno 13] Permission denied)" in line


def test_no_blender_at_all_is_an_error_that_says_where_to_get_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr(sys, "platform", "linux")
    with pytest.raises(
        ArgumentError, match=r"no Blender was found; want its path. Install it from blender\.org"
    ):
        find_blender()


def test_a_missing_scene_is_an_error(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["blender", str(tmp_path / "no.blend"), "-o", str(tmp_path / "out")])
    assert "no.blend: there is no such file" in one_line(done)


@pytest.mark.parametrize("text", ["", "a", "8-5", "-5", "5-", "1.5", "1-2-3", "9999999999"])
def test_other_ranges_of_frames_are_refused(text: str) -> None:
    with pytest.raises(ArgumentError, match=r"--frames is .*; want FIRST-LAST"):
        FrameRange.parse(text, "--frames", lowest=0)


def test_ranges_of_frames_are_read() -> None:
    found = [FrameRange.parse(text, "--frames", lowest=0) for text in ("1-48", "12", " 0 - 0 ")]
    assert found == [FrameRange(1, 48), FrameRange(12, 12), FrameRange(0, 0)]
