"""Tests of frames as games on phones are captured: PNG, motion and depth packed into bytes, no jitter."""

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from OpenImageIO import ImageSpec

from exr_parts import write_parts
from supersampler import ArgumentError, Conventions, ShotError
from supersampler.io.images import write_exr, write_png
from supersampler.io.shot import Shot, import_channels
from upscale_runs import run, succeeded

WIDTH, HEIGHT = 61, 35
NEAR, FAR = 0.5, 200.0
UV: dict[str, Any] = {"bytes": [["mv/*.png:R", "mv/*.png:G"], ["mv/*.png:B", "mv/*.png:A"]], "range": [-1, 1]}
DEPTH_24: dict[str, Any] = {"bytes": [f"depth/*.png:{name}" for name in "RGB"], "range": [0, 1]}
DEPTH_8 = {"bytes": ["depth/*.png:R"], "range": [0, 1]}
COLOR = [f"color/*.png:{name}" for name in "RGB"]
CONVENTIONS: dict[str, Any] = {
    "srgb": True, "motion_unit": "uv", "motion_direction": "current_minus_previous",
    "depth": "reversed", "near": NEAR, "far": FAR,
}  # fmt: skip


@dataclass(frozen=True)
class Captured:
    """Frames in this package's conventions, display-referred: colour in [0, 1]."""

    color: NDArray[np.float64]  # (frames, h, w, 3) linear
    motion: NDArray[np.float64]  # (frames, h, w, 2) render pixels, previous minus current
    distance: NDArray[np.float64]  # (frames, h, w)


def captured(frames: int = 2, farthest: float = 0.9 * FAR) -> Captured:
    random = np.random.default_rng(5)
    shape = frames, HEIGHT, WIDTH
    motion = random.uniform(-8.0, 8.0, (*shape, 2))
    motion[:, :5] = 0.0
    return Captured(random.uniform(0.0, 1.0, (*shape, 3)), motion, random.uniform(NEAR, farthest, shape))


def split(fractions: NDArray[np.float64], count: int) -> list[NDArray[np.uint8]]:
    """Return the bytes of numbers in [0, 1], the most significant first."""
    codes = np.rint(fractions * (256**count - 1)).astype(np.int64)
    return [((codes >> 8 * (count - 1 - place)) & 255).astype(np.uint8) for place in range(count)]


def device_depth(scene: Captured) -> NDArray[np.float64]:
    """Reversed depth with a finite far plane: 1 at the near plane, 0 at the far one."""
    ratio = NEAR / FAR
    return np.asarray((NEAR / scene.distance - ratio) / (1 - ratio))


def write_capture(
    folder: Path,
    scene: Captured,
    *,
    sign: tuple[int, int] = (-1, -1),
    depth_bytes: int = 3,
    low_first: bool = False,
) -> Path:
    """Write the frames; `sign` is that of the stored vectors in x and y, over previous minus current."""
    for name in ("color", "mv", "depth"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    linear = scene.color
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    uv = scene.motion / (WIDTH, HEIGHT) * sign
    for index in range(len(linear)):
        x, y = (split(0.5 * uv[index, ..., axis] + 0.5, 2) for axis in (0, 1))
        motion = [*x[::-1], *y[::-1]] if low_first else [*x, *y]
        depth = split(device_depth(scene)[index], depth_bytes)
        planes = {"color": np.rint(encoded[index] * 255).astype(np.uint8), "mv": np.stack(motion, -1)}
        planes["depth"] = np.stack(depth if depth_bytes == 3 else depth * 3, -1)
        for name, image in planes.items():
            write_png(folder / name / f"{name}_{index + 1:04d}.png", image)
    return folder


def opened(folder: Path, changes: dict[str, Any] | None = None, **conventions: Any) -> Shot:
    channel_map = {"color": COLOR, "motion": UV, "depth": DEPTH_24, **(changes or {})}
    return import_channels(folder, channel_map, conventions=Conventions(**{**CONVENTIONS, **conventions}))


def assert_is_the_capture(shot: Shot, scene: Captured, depth_step: float = 2.0**-24) -> None:
    assert (shot.render_size, len(shot)) == ((WIDTH, HEIGHT), len(scene.color))
    half_step = np.array([WIDTH, HEIGHT]) / 65535
    for index, item in enumerate(shot):
        frame, inverse = item.frame, NEAR / scene.distance[index]
        color = np.asarray(frame.color)
        assert np.abs(color - scene.color[index]).max() < 2.4 / 255 / 2  # the curve's steepest slope
        assert (np.abs(frame.motion - scene.motion[index]) <= half_step * 1.001).all()
        assert np.abs(frame.depth - inverse).max() <= (0.51 * depth_step + 1e-7) * (1 - NEAR / FAR)
        assert frame.jitter == (0.0, 0.0)


def test_the_map_shown_in_the_docs_is_read(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "docs" / "shots.md").read_text(encoding="utf-8")
    shown = json.loads(re.findall(r"```json\n(.*?)```", text, flags=re.DOTALL)[3])
    scene, folder = captured(), write_capture(tmp_path, captured())
    (folder / "mv").rename(folder / "motion")
    assert shown.pop("reference") == [f"native/*.png:{name}" for name in "RGB"]
    assert_is_the_capture(opened(folder, shown), scene)


@pytest.mark.parametrize(
    ("written", "changes", "conventions"),
    [
        ({}, {}, {}),
        ({"sign": (1, -1)}, {}, {"motion_direction": "previous_minus_current", "motion_flip_y": True}),
        ({"low_first": True}, {"motion": {**UV, "bytes": [each[::-1] for each in UV["bytes"]]}}, {}),
    ],
    ids=["as documented", "another direction", "the low byte first"],
)
def test_motion_packed_by_16_bits_comes_out_within_half_a_step(
    tmp_path: Path, written: Any, changes: dict[str, Any], conventions: dict[str, Any]
) -> None:
    scene = captured()
    assert_is_the_capture(opened(write_capture(tmp_path, scene, **written), changes, **conventions), scene)


def test_floats_around_a_half_come_out_by_their_range(tmp_path: Path) -> None:
    scene = captured(1)
    write_capture(tmp_path, scene)
    stored = 0.5 - 0.5 * scene.motion[0] / (WIDTH, HEIGHT)  # current minus previous
    write_exr(tmp_path / "mv.0001.exr", stored.astype(np.float32), ["U", "V"])
    motion = {"channels": ["*.exr:U", "*.exr:V"], "range": [-1, 1]}
    assert_is_the_capture(opened(tmp_path, {"motion": motion}), scene)


@pytest.mark.parametrize("ends", [(0, 50), (50, 0), (-25, 25)])
def test_outside_of_a_data_window_packed_depth_is_sky_and_motion_is_0(
    tmp_path: Path, ends: tuple[int, int]
) -> None:
    spec = ImageSpec(4, 6, 3, "float")
    spec.channelnames, spec.x, spec.full_width, spec.full_height = ("D", "U", "V"), 2, 8, 6
    depth, motion = (20.0 - ends[0]) / (ends[1] - ends[0]), 0.625
    write_parts(tmp_path / "f.0001.exr", (spec, np.full((6, 4, 3), (depth, motion, motion), np.float32)))
    write_exr(tmp_path / "color.0001.exr", np.zeros((6, 8, 3), np.float32))
    described: dict[str, Any] = {
        "color": [f"color.*.exr:{axis}" for axis in "RGB"],
        "depth": {"channels": ["f.*.exr:D"], "range": ends},
        "motion": {"channels": ["f.*.exr:U", "f.*.exr:V"], "range": [-4, 4]},
    }
    conventions = Conventions(depth="linear", near=1.0)
    frame = import_channels(tmp_path, described, conventions=conventions).read(0).frame
    np.testing.assert_array_equal(frame.depth[:, :2], 0.0)
    np.testing.assert_allclose(frame.depth[:, 2:6], 1 / 20.0)
    np.testing.assert_array_equal(frame.motion[:, :2], 0.0)
    np.testing.assert_array_equal(frame.motion[:, 2:6], 1.0)


def test_depth_of_8_bits_comes_out_within_half_a_step(tmp_path: Path) -> None:
    scene = captured(farthest=70.0)  # code 0 is the far plane, which is sky
    shot = opened(write_capture(tmp_path, scene, depth_bytes=1), {"depth": DEPTH_8})
    assert_is_the_capture(shot, scene, depth_step=1 / 255)


def test_a_linear_depth_states_its_range_in_scene_units(tmp_path: Path) -> None:
    scene = captured(1)
    write_capture(tmp_path, scene)
    image = np.stack(split(scene.distance[0] / FAR, 3), -1)
    write_png(tmp_path / "depth" / "depth_0001.png", image)
    shot = opened(tmp_path, {"depth": {**DEPTH_24, "range": [0, FAR]}}, depth="linear")
    np.testing.assert_allclose(shot.read(0).frame.depth, NEAR / scene.distance[0], rtol=1e-4)


def test_a_range_with_a_code_for_0_keeps_zero_exact(tmp_path: Path) -> None:
    write_capture(tmp_path, captured(1))
    code = np.full((HEIGHT, WIDTH), 32768)
    write_png(tmp_path / "mv" / "mv_0001.png", np.stack([code >> 8, code & 255] * 2, -1).astype(np.uint8))
    shot = opened(tmp_path, {"motion": {**UV, "range": [-32768 / 32767.5, 32767 / 32767.5]}})
    assert (shot.read(0).frame.motion == 0).all()


def test_references_of_8_bits_are_decoded_to_linear(tmp_path: Path) -> None:
    item = opened(write_capture(tmp_path, captured()), {"reference": COLOR}).read(1)
    np.testing.assert_array_equal(np.asarray(item.reference), item.frame.color)


def test_the_command_imports_by_two_json_files(tmp_path: Path) -> None:
    scene, channels, conventions = captured(), tmp_path / "channels.json", tmp_path / "conventions.json"
    write_capture(tmp_path / "png", scene)
    channels.write_text(json.dumps({"color": COLOR, "motion": UV, "depth": DEPTH_24}))
    conventions.write_text(json.dumps(CONVENTIONS))
    options = ("--channels", channels, "--conventions", conventions)
    succeeded(run("import", tmp_path / "png", "-o", tmp_path / "shot", *options))
    assert_is_the_capture(Shot.open(tmp_path / "shot"), scene)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("motion", {"range": [-1, 1]}, r"channel_map\['motion'\]\['bytes'\] is None; want 2 lists of equal"),
        ("motion", {"bytes": ["R", "G"], "range": [-1, 1]}, r"\['bytes'\] is \['R', 'G'\]; want 2 lists of"),
        ("motion", {"bytes": [["R"], ["G", "B"]], "range": [-1, 1]}, "want 2 lists of equal length"),
        ("depth", {"bytes": [], "range": [0, 1]}, "want a list of 1 to 4 channels, the most significant"),
        ("depth", {"bytes": ["R"] * 5, "range": [0, 1]}, "want a list of 1 to 4 channels"),
        ("depth", {"bytes": ["R"], "range": [1, 1]}, r"\['range'\] is \[1, 1\]; want \[low, high\], two"),
        ("depth", {"bytes": ["R"], "range": [0, float("inf")]}, "want .* finite numbers: .* bytes that are"),
        ("depth", {"bytes": ["R"], "range": "0 to 1"}, r"want \[low, high\]"),
        ("depth", {"byte": ["R"], "range": [0, 1]}, "with 'byte'; want keys of bytes, channels, range. Did"),
        ("depth", {"bytes": ["R"], "channels": ["R"], "range": [0, 1]}, "with 'bytes' and 'channels'"),
        ("motion", {"channels": ["R"], "range": [0, 1]}, r"\['channels'\] is \['R'\]; want 2 channel names"),
        ("color", {"bytes": ["R"], "range": [0, 1]}, "want 3 channel names"),
    ],
)
def test_a_wrong_packing_is_named(tmp_path: Path, name: str, value: dict[str, Any], message: str) -> None:
    write_capture(tmp_path, captured(1))
    with pytest.raises(ArgumentError, match=message):
        opened(tmp_path, {name: value})


def test_channels_of_16_bits_are_no_bytes(tmp_path: Path) -> None:
    write_capture(tmp_path, captured(1))
    write_png(tmp_path / "depth" / "depth_0001.png", np.zeros((HEIGHT, WIDTH, 3), np.uint16))
    with pytest.raises(ShotError, match=r"depth_0001\.png: holds packed depth as uint16; want 8 bits a"):
        opened(tmp_path)
