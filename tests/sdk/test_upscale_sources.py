"""Tests of EXR files as other software lays them out, as sources of `upscale`."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from OpenImageIO import ImageBuf, ImageSpec, TypeDesc

from exr_parts import write_parts
from supersampler.io.images import read_header
from upscale_runs import (
    DISPLAY_SIZE,
    OURS,
    SIZE,
    files,
    images,
    moving,
    pixels,
    refusal,
    run,
    upscale,
    write_renders,
    write_shot,
)

NAMES = ("R", "G", "B", "depth.Z", "motion.X", "motion.Y")
BILINEAR = ("--method", "bilinear")
ACESCG = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)

# Layouts of EXR files


def frame_channels() -> np.ndarray:
    frame = moving(3)
    return np.dstack([np.asarray(frame.color), frame.depth, frame.motion]).astype(np.float32)


def spec_of(names: Sequence[str] = NAMES, **fields: Any) -> ImageSpec:
    spec = ImageSpec(*SIZE, len(names), "float")
    spec.channelnames = tuple(names)
    for name, value in fields.items():
        setattr(spec, name, value)
    return spec


def part(name: str, channels: slice, **fields: Any) -> tuple[ImageSpec, np.ndarray]:
    spec = spec_of(NAMES[channels], **fields)
    spec.attribute("oiio:subimagename", name)
    return spec, frame_channels()[..., channels]


def scrambled() -> tuple[ImageSpec, np.ndarray]:
    order = [4, 2, 3, 0, 5, 1]
    return spec_of(tuple(NAMES[at] for at in order)), frame_channels()[..., order]


WIDTH, HEIGHT = SIZE
LAYOUTS: dict[str, Any] = {
    "scanlines": lambda: [(spec_of(), frame_channels())],
    "tiles": lambda: [(spec_of(tile_width=16, tile_height=16), frame_channels())],
    "any order": lambda: [scrambled()],
    "mixed types": lambda: [
        (spec_of(channelformats=tuple(map(TypeDesc, ("half",) * 3 + ("float",) * 3))), frame_channels())
    ],
    "parts": lambda: [part("rgba", slice(0, 3)), part("data", slice(3, 6))],
    "overscan": lambda: [
        (
            spec_of(x=-2, y=-3, width=WIDTH + 4, height=HEIGHT + 6, full_width=WIDTH, full_height=HEIGHT),
            np.pad(frame_channels(), ((3, 3), (2, 2), (0, 0)), constant_values=9.0),
        )
    ],
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_frame_of_any_layout_is_upscaled_and_read_back_by_openimageio(tmp_path: Path, layout: str) -> None:
    conventions = ("--conventions", '{"depth": "linear", "far": 50.0}')
    write_parts(tmp_path / "in" / "f.0007.exr", *LAYOUTS[layout]())
    upscale(tmp_path / "in", tmp_path / "out", *conventions)
    image = ImageBuf(str(tmp_path / "out" / "f.0007.exr"))
    spec, size = image.spec(), (0, 0, *DISPLAY_SIZE)
    assert (image.has_error, image.nsubimages) == (False, 1)
    assert (spec.x, spec.y, spec.width, spec.height) == size
    assert (spec.full_x, spec.full_y, spec.full_width, spec.full_height) == size
    assert (spec.channelnames, str(spec.format), spec.tile_width) == (("R", "G", "B"), "half", 0)
    assert spec.get_string_attribute("compression") == "zip"
    write_parts(tmp_path / "plain" / "f.0007.exr", (spec_of(), frame_channels()))
    upscale(tmp_path / "plain", tmp_path / "want", *conventions)
    found, want = np.asarray(image.get_pixels()), pixels(tmp_path / "want" / "f.0007.exr")
    np.testing.assert_allclose(found, want, rtol=2e-3 if layout == "mixed types" else 1e-6)


def test_metadata_primaries_and_channels_that_are_no_input_arrive(tmp_path: Path) -> None:
    spec = spec_of((*NAMES, "A", "glow.R", "id"))
    for name, kind, value in (
        ("camera", "string", "cam1"), ("focal", "float", 35.0), ("take", "int", 4),
        ("smpte:TimeCode", "timecode", (123456, 7)), ("chromaticities", "float[8]", ACESCG),
        ("worldToCamera", "matrix", tuple(map(float, range(16)))), ("crop", "box2i", (0, 1, 8, 9)),
    ):  # fmt: skip
        spec.attribute(name, TypeDesc(kind), value)
    extra = np.full((*frame_channels().shape[:2], 3), (1.0, 0.25, 17.0), np.float32)
    write_parts(tmp_path / "in" / "f.0007.exr", (spec, np.dstack([frame_channels(), extra])))
    done = upscale(tmp_path / "in", tmp_path / "out", *OURS)
    image = ImageBuf(str(tmp_path / "out" / "f.0007.exr"))
    found = image.spec()
    assert found.channelnames == ("R", "G", "B", "A", "glow.R")
    np.testing.assert_allclose(
        np.asarray(image.get_pixels())[..., 3:], np.broadcast_to((1.0, 0.25), (36, 64, 2))
    )
    assert "cannot be blended: id" in done.stderr
    assert (found["camera"], found["take"], found["focal"]) == ("cam1", 4, 35.0)
    assert found.getattribute("smpte:TimeCode") == (123456, 7)
    assert found.getattribute("crop") == (0, 1, 8, 9)
    assert found.getattribute("worldToCamera") == tuple(range(16))
    np.testing.assert_allclose(found.getattribute("chromaticities"), ACESCG, rtol=1e-6)
    assert found["colorInteropID"] == "lin_ap1_scene"


@pytest.mark.parametrize("header", [None, "lin_rec2020"])
def test_a_stated_colour_space_is_kept_and_no_pixel_is_converted(tmp_path: Path, header: str | None) -> None:
    renders = write_renders(tmp_path / "in", {1: "f.0001"}, color_space=header)
    plain, stated = (tmp_path / name / "f.0001.exr" for name in ("plain", "stated"))
    upscale(renders, plain.parent, *OURS)
    upscale(renders, stated.parent, "--color-space", "ACEScg", *OURS)
    found = ImageBuf(str(stated)).spec()
    np.testing.assert_allclose(found.getattribute("chromaticities"), ACESCG, rtol=1e-6)
    assert found["colorInteropID"] == "lin_ap1_scene"
    np.testing.assert_array_equal(pixels(stated), pixels(plain))


def test_a_frame_of_another_colour_space_is_named_unless_one_is_stated_for_all(tmp_path: Path) -> None:
    renders = write_renders(tmp_path / "in", {1: "f.0001", 2: "f.0002"})
    write_renders(renders, {3: "f.0003"}, color_space="ACEScg")
    message = refusal("upscale", renders, "-o", tmp_path / "out", *BILINEAR, *OURS)
    assert "f.0003.exr: is in ACEScg by its header; frame 1 is in lin_rec709" in message
    assert [*images(tmp_path / "out")] == ["f.0001.exr", "f.0002.exr"]
    upscale(renders, tmp_path / "all", "--color-space", "ACEScg", *OURS)
    assert [*images(tmp_path / "all")] == ["f.0001.exr", "f.0002.exr", "f.0003.exr"]


SHOW = """
ocio_profile_version: 2
roles: {scene_linear: light, default: light}
file_rules: [!<Rule> {name: Default, colorspace: default}]
displays: {sRGB: [!<View> {name: Film, colorspace: light}]}
colorspaces: [!<ColorSpace> {name: light}]
"""


@pytest.mark.parametrize(("config", "stated"), [("show.ocio", None), ("ocio://default", "lin_ap1_scene")])
def test_a_role_is_that_of_the_configuration(tmp_path: Path, config: str, stated: str | None) -> None:
    (tmp_path / "show.ocio").write_text(SHOW)
    renders = write_renders(tmp_path / "in", {1: "f.0001"})
    path = str(tmp_path / config) if config == "show.ocio" else config
    options = "--color-space", "scene_linear", "--ocio", path, "--format", "png", "--format", "exr"
    upscale(renders, tmp_path / "out", *options, *OURS)
    assert read_header(tmp_path / "out/exr/f.0001.exr").metadata.get("colorInteropID") == stated


def test_a_configuration_that_was_edited_is_noticed(tmp_path: Path) -> None:
    config = tmp_path / "show.ocio"
    config.write_text(SHOW)
    renders = write_renders(tmp_path / "in", {1: "f.0001"})
    command = "--format", "png", "--ocio", config, "--color-space", "light", *OURS
    upscale(renders, tmp_path / "out", *command)
    assert "complete already" in upscale(renders, tmp_path / "out", *command).stderr
    config.write_text(SHOW + "# a comment")
    message = refusal("upscale", renders, "-o", tmp_path / "out", *BILINEAR, *command)
    assert "display transform was" in message


def test_a_frame_of_another_size_is_named_and_the_frames_before_it_are_kept(tmp_path: Path) -> None:
    renders = write_renders(tmp_path / "in", {n: f"f.{n:04d}" for n in (1, 2, 3)})
    spec, values = spec_of(width=20), frame_channels()[:, :20]
    spec.full_width = 20
    write_parts(renders / "f.0003.exr", (spec, values))
    message = refusal("upscale", renders, "-o", tmp_path / "out", "--method", "bilinear", *OURS)
    assert f"{renders / 'f.0003.exr'}: is 20x18; the shot says 32x18" in message
    assert [*images(tmp_path / "out")] == ["f.0001.exr", "f.0002.exr"]
    assert not [name for name in files(tmp_path / "out") if "partial" in name]


# Options with values that cannot be used


@pytest.mark.parametrize(
    "options",
    [
        *(("--frame-rate", rate) for rate in ("0", "-5", "nan", "inf")),
        *(("upscale", f"--{name}", "x") for name in ("frames", "display-size", "name", "view")),
        *(("upscale", "--scale", scale) for scale in ("0", "0.5")),
        ("upscale", "--precision", "int8", "--method", "taau"),
        ("upscale", "--color-space", ""),
        ("--conventions", "x"),
        ("--cuts", "x"),
    ],
)
def test_an_unusable_value_is_named_with_its_option(tmp_path: Path, options: tuple[str, ...]) -> None:
    shot = write_renders(tmp_path / "in", {n: f"f.{n:04d}" for n in range(2)})
    commands = [options[0]] if options[0] == "upscale" else ["upscale", "import"]
    for command in commands:
        given = options[options[0] == command :]
        done = run(command, shot, "-o", tmp_path / "out", *OURS, *given)
        assert (done.exit_code, done.stderr.count("\n")) == (2, 1), done.output
        assert f"error: {given[0]} is " in done.stderr
        assert not (tmp_path / "out").exists()


# Changes between the runs of a folder


def test_a_run_is_not_continued_with_another_jitter_or_other_channels(tmp_path: Path) -> None:
    shot, out = write_renders(tmp_path / "in", {n: f"f.{n:04d}" for n in range(3)}), tmp_path / "out"
    channels = {"color": ["R", "G", "B"], "depth": "depth.Z", "motion": ["motion.X", "motion.Y"]}

    def write_map(**changes: Any) -> None:
        content = {"channels": {**channels, **changes}, "conventions": {}}
        (shot / "channels.json").write_text(json.dumps(content))

    write_map()
    upscale(shot, out)
    before = files(out)
    (shot / "jitter.json").write_text("[[0.25, 0.0]]")
    assert "its frames had other jitter" in refusal("upscale", shot, "-o", out, *BILINEAR)
    (shot / "jitter.json").unlink()
    write_map(color=["G", "R", "B"])
    assert "its frames had other channels" in refusal("upscale", shot, "-o", out, *BILINEAR)
    assert files(out) == before
    upscale(shot, out, "--overwrite")
    assert "All 3 frames are complete already" in upscale(shot, out).stderr


def test_a_run_is_not_continued_with_other_names_of_aovs(tmp_path: Path) -> None:
    shot, out = write_shot(tmp_path / "shot", 2, aovs=np.ones((*SIZE[::-1], 2), np.float32)), tmp_path / "out"
    upscale(shot, out)
    stated = json.loads((shot / "shot.json").read_text())
    (shot / "shot.json").write_text(json.dumps({**stated, "aov_names": ["A", "dust"]}))
    assert "its frames had other channels" in refusal("upscale", shot, "-o", out, *BILINEAR)


def test_a_frame_that_was_rendered_again_after_its_image_is_named(tmp_path: Path) -> None:
    shot, out = write_renders(tmp_path / "in", {n: f"f.{n:04d}" for n in range(3)}), tmp_path / "out"
    upscale(shot, out, *OURS)
    assert "has changed" not in upscale(shot, out, *OURS).stderr
    write_renders(shot, {1: "f.0001"})
    assert "Frame 1 has changed since its image was written. --overwrite" in upscale(shot, out, *OURS).stderr
    assert "has changed" not in upscale(shot, out, *OURS, "--overwrite").stderr


def test_a_pass_of_its_own_files_that_was_rendered_again_is_named(tmp_path: Path) -> None:
    shot, out = write_renders(tmp_path / "in", {n: f"f.{n:04d}" for n in range(3)}), tmp_path / "out"
    write_renders(shot / "mv", {n: f"f.{n:04d}" for n in range(3)})
    channels = {
        "color": ["R", "G", "B"],
        "depth": "depth.Z",
        "motion": ["mv/*.exr:motion.X", "mv/*.exr:motion.Y"],
    }
    (shot / "channels.json").write_text(json.dumps({"channels": channels, "conventions": {}}))
    upscale(shot, out)
    assert "has changed" not in upscale(shot, out).stderr
    write_renders(shot / "mv", {2: "f.0002"})
    assert "Frame 2 has changed since its image was written" in upscale(shot, out).stderr
