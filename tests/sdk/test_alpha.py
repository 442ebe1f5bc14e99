"""Tests of alpha in results: colours of PNG and TIFF are not multiplied by it, those of EXR are."""

from pathlib import Path

import numpy as np
import pytest
from OpenImageIO import ImageBuf

from supersampler.cli.results import ImageOptions, OutputImage
from supersampler.io.display import display_transform, to_uint16
from supersampler.io.images import read_image, write_exr, write_png
from upscale_runs import OURS, upscale

SIZE = (12, 16)
ALPHA = np.tile(np.array([0.0, 0.25, 0.5, 1.0], np.float32).repeat(4), (12, 1))
INSIDE = np.tile([False, True, True, False], (12, 4))
"""Pixels whose neighbours have the same alpha."""
STRAIGHT = np.array([0.6, 0.3, 0.1], np.float32)


def write_frames(folder: Path) -> Path:
    """One EXR frame with alpha, whose colour is multiplied by it; a glow of 0.2 is where alpha is 0."""
    color = np.where(ALPHA[..., None] > 0, ALPHA[..., None] * STRAIGHT, np.float32(0.2))
    channels = dict(zip("RGB", np.moveaxis(color, -1, 0), strict=True))
    channels |= {"A": ALPHA, "fog": np.ones(SIZE, np.float32), "Z": np.full(SIZE, 0.5, np.float32)}
    channels |= {"motion.X": np.zeros(SIZE, np.float32), "motion.Y": np.zeros(SIZE, np.float32)}
    write_exr(folder / "s.0001.exr", channels)
    return folder


@pytest.mark.parametrize("name", ["png", "tif"])
def test_alpha_is_kept_beside_straight_colours(tmp_path: Path, name: str) -> None:
    options = ("--scale", "1", "--format", name, "--format", "exr")
    upscale(write_frames(tmp_path / "in"), tmp_path / "out", *OURS, *options)
    path = tmp_path / "out" / name / f"s.0001.{name}"
    image = ImageBuf(str(path)).spec()
    assert (image.channelnames, image.alpha_channel) == (("R", "G", "B", "A"), 3)
    found = read_image(path)
    np.testing.assert_allclose(found["A"][INSIDE], ALPHA[INSIDE], atol=3e-3)
    covered = np.stack([found[axis] for axis in "RGB"], axis=-1)[INSIDE & (ALPHA > 0)]
    np.testing.assert_allclose(covered, np.broadcast_to(covered[-1], covered.shape), atol=6e-3)
    assert (found["R"][INSIDE & (ALPHA == 0)] > 0.1).all()  # the glow is still there, for those who add it
    linear = read_image(tmp_path / "out" / "exr" / "s.0001.exr")
    multiplied = (ALPHA * STRAIGHT[0])[INSIDE & (ALPHA > 0)]
    np.testing.assert_allclose(linear["R"][INSIDE & (ALPHA > 0)], multiplied, rtol=3e-3)


def test_what_is_covered_is_shown_as_without_alpha(tmp_path: Path) -> None:
    image, aovs = np.full((2, 3, 3), 0.4, np.float32), np.ones((2, 3, 1), np.float32)
    options = ImageOptions(formats=["tif", "mp4"])
    video = options.write(tmp_path, 1, OutputImage(image=image, exposure=1.0, aovs=aovs))
    found = read_image(tmp_path / "0001.tif")
    want = to_uint16(display_transform(image)) / 65535
    np.testing.assert_allclose(np.stack([found[axis] for axis in "RGBA"], -1)[..., :3], want, atol=1e-5)
    assert (found["A"] == 1).all()
    assert video is not None
    assert video.shape == (2, 3, 3)


def test_a_video_shows_the_image_over_black(tmp_path: Path) -> None:
    image, aovs = np.full((2, 3, 3), 0.1, np.float32), np.full((2, 3, 1), 0.5, np.float32)
    written = [
        ImageOptions(formats=names).write(tmp_path, 1, OutputImage(image=image, exposure=1.0, aovs=aovs))
        for names in (["png", "mp4"], ["mp4"])
    ]
    np.testing.assert_array_equal(written[0], written[1])


def test_colours_of_png_frames_are_not_divided_by_their_alpha(tmp_path: Path) -> None:
    pixels = np.full((*SIZE, 4), 128, np.uint8)
    write_png(tmp_path / "in" / "color" / "c.0001.png", pixels)
    write_frames(tmp_path / "in")
    channels = """{"color": ["color/c.*.png:R", "color/c.*.png:G", "color/c.*.png:B"], "depth": "Z",
        "aovs": "color/c.*.png:A", "motion": ["motion.X", "motion.Y"]}"""
    options = ("--channels", channels, "--conventions", '{"srgb": true}', "--scale", "1")
    upscale(tmp_path / "in", tmp_path / "out", *options)
    found = read_image(tmp_path / "out" / "c.0001.png")
    for name in "RGBA":
        np.testing.assert_allclose(found[name], 128 / 255, atol=5e-3)


def test_without_alpha_png_has_three_channels(tmp_path: Path) -> None:
    image, aovs = np.full((2, 3, 3), 0.4, np.float32), np.ones((2, 3, 2), np.float32)
    for names in (None, ("fog", "mist")):
        output = OutputImage(image=image, exposure=1.0, aovs=aovs, aov_names=names)
        ImageOptions(formats=["png"]).write(tmp_path, 1, output)
        assert read_image(tmp_path / "0001.png").keys() == set("RGB")


@pytest.mark.parametrize("value", [np.nan, -1.0, 2.0])
def test_alpha_is_written_within_0_and_1(tmp_path: Path, value: float) -> None:
    image, aovs = np.full((2, 3, 3), 0.4, np.float32), np.full((2, 3, 1), value, np.float32)
    ImageOptions(formats=["png"]).write(tmp_path, 1, OutputImage(image=image, exposure=1.0, aovs=aovs))
    assert (read_image(tmp_path / "0001.png")["A"] == (value == 2.0)).all()
