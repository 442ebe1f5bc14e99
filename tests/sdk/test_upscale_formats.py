"""Tests of the files that `upscale` writes: EXR, PNG, TIFF and video, and how they show colours."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from OpenImageIO import ImageBuf, ImageSpec

from exr_parts import write_parts
from supersampler.io import video
from supersampler.io.display import BT709, to_uint8
from supersampler.io.display_transforms import display_transform_from
from supersampler.io.images import write_exr
from supersampler.io.shot import ShotWriter
from upscale_runs import (
    DISPLAY_SIZE,
    OURS,
    images,
    interrupt_at,
    moving,
    pixels,
    refusal,
    run,
    upscale,
    write_renders,
    write_shot,
)

av = pytest.importorskip("av")

COUNT = 4
FORMATS = ("exr", "mp4", "png", "tif")
VIEW = "ACES 2.0 - SDR 100 nits (Rec.709)"


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_shot(tmp_path_factory.mktemp("shots") / "tiny", COUNT, frame_rate=23.976)


@pytest.fixture(scope="module")
def every(shot: Path) -> Path:
    """Results in all formats at once."""
    upscale(shot, shot.parent / "every", *formats(*FORMATS))
    return shot.parent / "every"


def formats(*names: str) -> list[str]:
    return [word for name in names for word in ("--format", name)]


def shown(path: Path) -> Any:
    """Return the pixels of an image file as integers, as they are stored."""
    image = ImageBuf(str(path))
    return np.asarray(image.get_pixels(image.spec().format))


def decoded(path: Path) -> list[np.ndarray]:
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


def assert_same_images(video: Path, other: Path) -> None:
    """Compare images, as x264 does not always write the same bytes for the same images."""
    for image, want in zip(decoded(video), decoded(other), strict=True):
        assert np.abs(image.astype(int) - want).mean() < 0.5


def luma_difference(a: np.ndarray, b: np.ndarray) -> float:
    """Return the mean difference of what a video holds at full size."""
    return float(np.abs((a.astype(int) - b) @ BT709).mean())


@pytest.mark.parametrize("name", FORMATS)
def test_a_single_format_goes_into_the_folder_itself(
    shot: Path, every: Path, tmp_path: Path, name: str
) -> None:
    upscale(shot, tmp_path, *formats(name))
    names = ["video.mp4"] if name == "mp4" else [f"{number:04d}.{name}" for number in range(COUNT)]
    below = every if name == "mp4" else every / name
    assert images(tmp_path) == {each: (below / each).read_bytes() for each in names}


def test_all_formats_show_one_image(every: Path) -> None:
    frames = decoded(every / "video.mp4")
    assert len(frames) == COUNT
    for number, frame in enumerate(frames):
        png, tif = shown(every / f"png/{number:04d}.png"), shown(every / f"tif/{number:04d}.tif")
        assert (png.dtype, tif.dtype, png.shape) == (np.uint8, np.uint16, (36, 64, 3))
        assert np.abs(png - tif / 257.0).max() <= 0.5 + 1 / 257
        assert luma_difference(frame, png) < 2


def stopped_at(position: int, shot: Path, output: Path, *options: str) -> str:
    """Run `upscale`, stopped before a frame is written; returns what it said."""
    with pytest.MonkeyPatch.context() as patch:
        interrupt_at(position, patch)
        done = run("upscale", shot, "-o", output, "--method", "bilinear", *options)
    assert done.exit_code == 130
    return str(done.stderr)


def test_a_video_without_images_restarts_after_a_stop(shot: Path, every: Path, tmp_path: Path) -> None:
    said = stopped_at(2, shot, tmp_path, "--format", "mp4")
    assert f"Stopped: 0 of {COUNT} frames are complete." in said
    assert images(tmp_path) == {}
    upscale(shot, tmp_path, "--format", "mp4")
    assert [*images(tmp_path)] == ["video.mp4"]
    assert_same_images(tmp_path / "video.mp4", every / "video.mp4")
    assert f"All {COUNT} frames are complete already" in upscale(shot, tmp_path, "--format", "mp4").stderr


def test_images_beside_a_video_are_kept_after_a_stop(shot: Path, every: Path, tmp_path: Path) -> None:
    said = stopped_at(2, shot, tmp_path, *formats("png", "mp4"))
    assert f"Stopped: 2 of {COUNT} frames are complete." in said
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.png")}
    assert sorted(path.name for path in before) == ["0000.png", "0001.png"]
    upscale(shot, tmp_path, *formats("png", "mp4"))
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert_same_images(tmp_path / "video.mp4", every / "video.mp4")


def test_a_run_killed_after_its_video_ends_as_one_that_was_not(shot: Path, tmp_path: Path) -> None:
    upscale(shot, tmp_path, *formats("png", "mp4"))
    record = tmp_path / "upscale.json"
    ended = record.read_text()
    record.write_text(ended.replace(f'"video.mp4": {COUNT}', '"video.mp4": 1'))
    said = upscale(shot, tmp_path, *formats("png", "mp4")).stderr
    assert f"All {COUNT} frames are complete already" in said
    assert record.read_text() == ended


def test_a_video_can_be_requested_later(shot: Path, every: Path, tmp_path: Path) -> None:
    upscale(shot, tmp_path)
    before = images(tmp_path)
    upscale(shot, tmp_path, *formats("exr", "mp4"))
    assert_same_images(tmp_path / "video.mp4", every / "video.mp4")
    assert images(tmp_path).items() >= before.items()


@pytest.mark.parametrize("name", ["zip", "dwaa", "piz", "none"])
def test_exr_is_half_and_compressed_as_chosen(shot: Path, every: Path, tmp_path: Path, name: str) -> None:
    upscale(shot, tmp_path, "--compression", name, "--frames", "0", "--preroll", "0")
    spec = ImageBuf(str(tmp_path / "0000.exr")).spec()
    assert (spec.get_string_attribute("compression"), str(spec.format)) == (name, "half")
    want = pixels(every / "exr" / "0000.exr")
    np.testing.assert_allclose(
        pixels(tmp_path / "0000.exr"), want, rtol=0, atol=0.05 if name == "dwaa" else 0
    )


# sRGB frames


def write_ramp(folder: Path, kind: str, suffix: str) -> np.ndarray:
    """Write one frame of grey steps, 8 pixels wide each; returns the integers of the steps, (h, w, 3)."""
    most, height, width = np.iinfo(kind).max, 18, 32 * 8
    steps = np.repeat(np.linspace(0, most, 32).round().astype(kind), 8)
    values = np.broadcast_to(steps[None, :, None], (height, width, 3)).copy()
    write_parts(folder / f"c.0005.{suffix}", (ImageSpec(width, height, 3, kind), values))
    zero = np.zeros((height, width), np.float32)
    write_exr(folder / "data" / "d.0005.exr", {"Z": zero + 0.5, "U": zero, "V": zero})
    names = {"color": ["R", "G", "B"], "depth": ["Z"], "motion": ["U", "V"]}
    channels = {ours: [f"data/*.exr:{name}" for name in theirs] for ours, theirs in names.items()}
    channels["color"] = [f"*.{suffix}:{name}" for name in "RGB"]
    described = {"channels": channels, "conventions": {"srgb": True}}
    (folder / "channels.json").write_text(json.dumps(described))
    return values


@pytest.mark.parametrize("scale", [1, 2])
@pytest.mark.parametrize(
    ("kind", "suffix", "want"), [("uint8", "png", "png"), ("uint16", "png", "png"), ("uint16", "tif", "tif")]
)
def test_srgb_frames_keep_format_type_and_values(
    tmp_path: Path, kind: str, suffix: str, want: str, scale: int
) -> None:
    values = write_ramp(tmp_path / "in", kind, suffix)
    upscale(tmp_path / "in", tmp_path / "out", "--scale", scale)
    assert [*images(tmp_path / "out")] == [f"c.0005.{want}"]
    found = shown(tmp_path / "out" / f"c.0005.{want}")
    assert found.dtype == np.dtype(kind)
    middle = found[:, 4 * scale :: 8 * scale].astype(int)  # of each step, where neighbours do not reach
    most = np.iinfo(kind).max
    np.testing.assert_allclose(middle, np.broadcast_to(values[:1, 4::8], middle.shape), atol=most / 255)


def test_srgb_frames_as_exr_are_linear_light(tmp_path: Path) -> None:
    values = write_ramp(tmp_path / "in", "uint8", "png")[0, 4::8, 0] / 255.0
    upscale(tmp_path / "in", tmp_path / "out", "--scale", "1", "--format", "exr")
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(pixels(tmp_path / "out" / "c.0005.exr")[9, 4::8, 0], linear, atol=1e-3)


# Display options


@pytest.mark.parametrize(
    "options",
    [{"view": VIEW}, {"exposure": -1.5}, {"ocio": "ocio://default"}, {"view": VIEW, "exposure": 1.0}],
)
def test_display_options_are_shown(
    shot: Path, every: Path, tmp_path: Path, options: dict[str, object]
) -> None:
    words = [word for name, value in options.items() for word in (f"--{name}", str(value))]
    upscale(shot, tmp_path, *formats("exr", "png", "mp4"), *words)
    light = pixels(tmp_path / "exr" / "0002.exr")
    np.testing.assert_array_equal(light, pixels(every / "exr" / "0002.exr"))
    want = to_uint8(display_transform_from(**options).show(light)).astype(int)  # type: ignore[arg-type]
    png = shown(tmp_path / "png" / "0002.png").astype(int)
    assert np.abs(png - want).max() <= 1  # the EXR has half floats
    assert np.abs(png - shown(every / "png" / "0002.png")).mean() > 3
    assert luma_difference(decoded(tmp_path / "video.mp4")[2], png) < 2


@pytest.mark.parametrize("options", [("--exposure", "-1.5"), ("--view", VIEW), ()])
def test_pre_exposure_is_not_shown(tmp_path: Path, options: tuple[str, ...]) -> None:
    for name, factors in (("plain", [1.0, 1.0]), ("pre", [0.25, 4.0])):
        with ShotWriter(tmp_path / name, name="shot", display_size=DISPLAY_SIZE, frame_rate=24.0) as writer:
            for index, factor in enumerate(factors):
                frame = moving(index, exposure=0.5)
                color = np.asarray(frame.color) * np.float32(factor)
                writer.write(replace(frame, color=color, pre_exposure=factor))
        upscale(tmp_path / name, tmp_path / f"{name} out", "--format", "png", *options)
    assert images(tmp_path / "pre out") == images(tmp_path / "plain out")


def test_options_without_effect_are_named(shot: Path, tmp_path: Path) -> None:
    given = ("--view", VIEW, "--maps", "--scratch", tmp_path)
    without = upscale(shot, tmp_path / "out", *given).stderr
    for option, other in (("view", "another --format"), ("maps", "--compare"), ("scratch", "--passes 2")):
        assert f"--{option} has no effect without {other}." in without
    assert "no effect" not in upscale(shot, tmp_path / "b", *given, "--compare", "--passes", "2").stderr


def test_the_colour_space_of_the_shot_is_that_of_the_view(tmp_path: Path) -> None:
    renders = write_renders(tmp_path / "in", {1: "f.0001"})
    command = ("--format", "png", "--view", VIEW, *OURS)
    upscale(renders, tmp_path / "rec709", *command)
    upscale(renders, tmp_path / "acescg", "--color-space", "ACEScg", *command)
    a, b = (shown(tmp_path / name / "f.0001.png").astype(int) for name in ("rec709", "acescg"))
    assert np.abs(a - b).mean() > 3


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--ocio", "none.ocio", "none.ocio: there is no such file"),
        ("--ocio", "ocio://nothing", "--ocio is 'ocio://nothing'; want one of ocio://default"),
        ("--view", "ACES", "--view is 'ACES'; want one of ACES 2.0 - SDR"),
        ("--display", "TV", "--display is 'TV'; want one of sRGB"),
        ("--look", "grim", "--look is 'grim'; want"),
        ("--exposure", "99", "--exposure is 99.0; want stops, -24 to 24"),
        ("--format", "mp4", "video.mp4: cannot be written: this PyAV has no encoder libnone"),
    ],
)
def test_a_missing_display_or_codec_is_one_line_and_nothing_is_written(
    shot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, option: str, value: str, message: str
) -> None:
    monkeypatch.setattr(video, "_CODEC", "libnone")
    assert message in refusal("upscale", shot, "-o", tmp_path / "out", "--format", "png", option, value)
    assert [*tmp_path.iterdir()] == []
