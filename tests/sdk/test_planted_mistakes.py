"""Tests of the checks on shots of Blender, VTK and our own renderer: planted mistakes are named."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plain_frames import complaints
from supersampler import Conventions, Frame, RawFrame, Shot, halton_jitter
from supersampler.conventions.encodings import srgb_encoded
from supersampler.validation import detect_conventions
from supersampler_model.data.product_shot import Plaza
from supersampler_model.data.renderer.renderer import Renderer

TESTS = Path(__file__).parents[1]
FOLDERS = {"blender": TESTS / "blender" / "checked", "vtk": TESTS / "vtk" / "recorded"}


Shots = Callable[[str], list[Frame]]
"""Frames of one renderer: "right", "half" or "fixed" with half or none of the stated jitter, "filtered"."""


def own_frames(part: float, count: int, frame_rate: float) -> list[Frame]:
    """Frames of the plaza, whose jitter is a part of what they state."""
    renderer, sequence = Renderer((256, 144)), Plaza()
    sequence.spec = replace(sequence.spec, frame_rate=frame_rate)
    frames = []
    for index in range(10, 10 + count):
        x, y = halton_jitter(index, 2.0)
        color, surfaces = renderer.frame(sequence.scene(index), (128, 72), jitter=(part * x, part * y))
        frames.append(
            Frame(
                color=color, depth=surfaces.depth, motion=surfaces.motion.astype(np.float16),
                jitter=(x, y), reset=index == 10,
            )
        )  # fmt: skip
    return frames


def own_filtered() -> list[Frame]:
    """A frame of the plaza whose colour is a mean over the pixel."""
    renderer, scene = Renderer((480, 270)), Plaza().scene(12)
    offsets = [(x, y) for x in (-0.4, 0.0, 0.4) for y in (-0.4, 0.0, 0.4)]
    colors = [renderer.frame(scene, (480, 270), jitter=offset)[0].astype(np.float32) for offset in offsets]
    surfaces = renderer.frame(scene, (480, 270), jitter=(0.0, 0.0))[1]
    motion = surfaces.motion.astype(np.float16)
    color = np.stack(colors).mean(axis=0)
    return [Frame(color=color, depth=surfaces.depth, motion=motion, jitter=(0.0, 0.0), reset=True)]


OWN: dict[str, Callable[[], list[Frame]]] = {
    "right": lambda: own_frames(1.0, 4, 5.0),
    "half": lambda: own_frames(0.5, 3, 30.0),
    "fixed": lambda: own_frames(0.0, 3, 30.0),
    "filtered": own_filtered,
}


@cache
def frames_of(renderer: str, name: str) -> list[Frame]:
    return OWN[name]() if renderer == "own" else [item.frame for item in Shot.open(FOLDERS[renderer] / name)]


@pytest.fixture(params=["blender", "vtk", "own"])
def shots(request: pytest.FixtureRequest) -> Shots:
    return partial(frames_of, request.param)


def notes(frames: list[Frame]) -> str:
    """Return the output of `supersampler check` for the frames."""
    return detect_conventions([Conventions().converter().from_frame(frame) for frame in frames]).summary()


def colored(frame: Frame, change: Callable[[Any], Any]) -> Frame:
    assert frame.color is not None
    return replace(frame, color=change(frame.color.astype(np.float32)).astype(np.float32))


def misread(frame: Frame, **overrides: Any) -> Frame:
    """The frame of other conventions, taken for the SDK's own."""
    raw = Conventions(**overrides).converter().from_frame(frame)
    return Conventions().converter().to_frame(raw)


def image_file(color: Any) -> Any:
    """Eight bits, as in an image file, in [0, 1]."""
    return np.rint(255 * srgb_encoded(np.clip(color, 0, 1))) / 255


def in_steps(values: Any, count: int) -> Any:
    most = values.max()
    return (np.rint(values / most * count) / count * most).astype(np.float32)


def coarse_motion(frame: Frame) -> Frame:
    """Vectors in steps of half a pixel, as of half floats around 0.5."""
    return replace(frame, motion=(np.rint(frame.motion.astype(np.float32) * 2) / 2))


PLANTED: dict[str, tuple[Callable[[Frame], Frame], str]] = {
    "motion zero": (
        lambda f: replace(f, motion=np.zeros_like(f.motion)), "frame.motion is 0 everywhere, although"
    ),
    "bytes": (lambda f: colored(f, lambda c: 255 * image_file(c)), "frame.color is in whole numbers up to 2"),
    "sRGB": (lambda f: colored(f, image_file), "frame.color is in steps of 1/255"),
    "bottom-up": (lambda f: misread(f, bottom_up=True), "frame.color is bottom-up with depth and motion"),
    "coarse depth": (lambda f: replace(f, depth=in_steps(f.depth, 255)), "evenly spaced values"),
    "reset": (lambda f: replace(f, reset=True), "frame.reset is True in 4 consecutive frames"),
}  # fmt: skip


def test_correct_frames_pass_silently(shots: Shots) -> None:
    assert complaints(*shots("right")) == ""
    assert complaints(*shots("right"), validate="strict") == ""
    detection = detect_conventions([Conventions().converter().from_frame(frame) for frame in shots("right")])
    assert detection.agrees
    assert detection.notes == ()


@pytest.mark.parametrize("name", PLANTED)
def test_a_planted_mistake_is_the_only_one_named(shots: Shots, name: str) -> None:
    change, message = PLANTED[name]
    said = complaints(*[change(frame) for frame in shots("right")])
    assert message in said
    assert len(said.splitlines()) == 1


@pytest.mark.parametrize("renderer", FOLDERS)
@pytest.mark.parametrize("jitter", [{"jitter_sign": -1}, {"jitter_unit": "ndc"}])
def test_a_wrong_jitter_is_not_taken_for_jitter_in_vectors_of_another_unit(
    renderer: str, jitter: dict[str, Any]
) -> None:
    frames = [misread(frame, motion_unit="uv", **jitter) for frame in frames_of(renderer, "right")]
    said, *others = complaints(*frames).splitlines()
    assert "Try Conventions(motion_unit='uv')" in said
    assert all("jitter_unit" in other for other in others), "of wrong readings only the first is named"


@pytest.mark.parametrize("name", [name for name in PLANTED if name != "bottom-up"])
def test_check_notes_a_planted_mistake(shots: Shots, name: str) -> None:
    change, message = PLANTED[name]
    assert message in notes([change(frame) for frame in shots("right")])


@pytest.mark.parametrize("preset", [Conventions(), Conventions.vtk()])
def test_check_blames_the_rows_where_all_is_bottom_up(shots: Shots, preset: Conventions) -> None:
    turned, upright = replace(preset, bottom_up=True), replace(preset, bottom_up=False)
    raws = [turned.converter().from_frame(frame) for frame in shots("right")]
    detection = detect_conventions(raws, conventions=upright)
    assert detection.conventions == turned
    assert "Rows seem to be bottom-up" in detection.summary()


def test_check_blames_the_rows_of_vtk_where_nothing_is_stated(shots: Shots) -> None:
    raws = [Conventions.vtk().converter().from_frame(frame) for frame in shots("right")]
    found = detect_conventions(raws).conventions
    assert found.bottom_up
    assert not found.motion_flip_y
    assert not found.jitter_flip_y
    assert found.depth == "forward_infinite"


def test_jitter_missing_from_the_image_is_reported(shots: Shots) -> None:
    assert complaints(*shots("fixed")).startswith("frame.jitter is not in the image")
    assert "frame.jitter is not in the image" in notes(shots("fixed"))
    assert "Write" not in notes(shots("fixed"))


def test_a_fraction_of_the_jitter_is_estimated(shots: Shots) -> None:
    factor = float(complaints(*shots("half")).removeprefix("frame.jitter is ").split()[0])
    assert factor == pytest.approx(0.5, abs=0.2)
    assert "times as large in the image as stated" in notes(shots("half"))


def test_a_wide_pixel_filter_is_hinted_at(shots: Shots) -> None:
    assert "of the depth edges" in complaints(*shots("filtered"), validate="strict")


@pytest.mark.parametrize("unit", ["uv", "ndc", "pixels"])
def test_vectors_stored_around_a_half_are_the_only_mistake(shots: Shots, unit: str) -> None:
    size, scale = shots("right")[0].size, 0.01 if unit == "pixels" else 1.0
    half = np.array({"uv": np.multiply(size, 0.5), "ndc": np.multiply(size, 0.25), "pixels": 0.5}[unit])
    motions = [frame.motion * scale + half.astype(np.float32) for frame in shots("right")]
    frames = [replace(frame, motion=each) for frame, each in zip(shots("right"), motions, strict=True)]
    for lines in (complaints(*frames), notes(frames)):
        (said,) = [line for line in lines.splitlines() if line.startswith("frame.")]
        assert "pixels everywhere, as if 0 were stored as 0.5" in said


def test_coarse_motion_is_reported_with_its_step(shots: Shots) -> None:
    larger = [replace(frame, motion=frame.motion.astype(np.float32) * 3) for frame in shots("right")]
    assert "frame.motion is in steps of 0.5 pixels" in complaints(*[coarse_motion(frame) for frame in larger])
    assert "in steps" not in complaints(*larger)


def test_a_depth_buffer_with_a_far_plane_needs_its_planes(shots: Shots) -> None:
    near, far = 0.5 / float(max(frame.depth.max() for frame in shots("right"))), 1e4
    unit = [replace(frame, depth=frame.depth * np.float32(near)) for frame in shots("right")]
    frames = [misread(frame, depth="forward", near=near, far=far) for frame in unit]
    said = complaints(*frames)
    assert "frame.depth is of another kind" in said
    assert "Conventions(depth='forward', near=, far=) with the planes of the camera" in said
    assert "linear" not in said


def test_depth_that_is_linear_along_planes_is_not_said_to_be_a_distance() -> None:
    """A parallel projection: 1 / depth is linear on the screen, as a distance would be in a perspective."""
    y, x = np.mgrid[:60, :80]
    depth = (1.0 / (2.0 + 0.05 * y + 0.02 * x)).astype(np.float32)
    color = np.random.default_rng(0).random((60, 80, 3), np.float32)
    motion = np.zeros((60, 80, 2), np.float32)
    frames = [Frame(color=color, depth=depth, motion=motion, jitter=halton_jitter(i, 2.0)) for i in range(2)]
    assert "depth" not in complaints(*frames)
    raws = [RawFrame(color=f.color, depth=f.depth, motion=f.motion, jitter=f.jitter) for f in frames]
    detection = detect_conventions(raws)
    assert detection.conventions.depth == "reversed_infinite"
    assert "may be a parallel projection" in detection.depth.reason


def test_resets_on_different_images_are_not_a_mistake() -> None:
    chance = np.random.default_rng(0)
    frames = []
    for index in range(5):
        color = np.kron(chance.random((12, 20, 3), np.float32), np.ones((5, 4, 1), np.float32))
        depth, motion = np.full((60, 80), 0.5, np.float32), np.zeros((60, 80, 2), np.float32)
        jitter = halton_jitter(index, 2.0)
        frames.append(Frame(color=color, depth=depth, motion=motion, jitter=jitter, reset=True))
    assert complaints(*frames) == ""


def test_colour_upside_down_is_blamed_and_motion_is_not(shots: Shots) -> None:
    frames = [colored(frame, lambda color: color[::-1]) for frame in shots("right")]
    said = complaints(*frames)
    assert "frame.color is upside down relative to depth" in said
    assert len(said.splitlines()) == 1
    assert "frame.color is upside down relative to depth" in notes(frames)
    assert "Write" not in notes(frames)
