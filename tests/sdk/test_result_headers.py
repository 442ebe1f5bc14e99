"""Tests of the headers of results: pixel aspect, frame rate, time code, views, and what is not copied."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from OpenImageIO import ImageBuf

from supersampler.conventions import Conventions
from supersampler.io.images import Metadata, TypedValues, write_exr
from supersampler.io.shot import copy_shot, import_named_channels, open_source
from upscale_runs import OURS, upscale, write_renders

FILM = TypedValues("rational", (24000, 1001))
TIME = TypedValues("timecode", (16909060, 0))


def results(tmp_path: Path, metadata: Metadata, *options: object) -> Path:
    """Upscale two frames with these entries in their headers; return the folder of the results."""
    write_renders(tmp_path / "in", {1: "s.0001", 2: "s.0002"}, metadata=metadata)
    upscale(tmp_path / "in", tmp_path / "out", *OURS, *options)
    return tmp_path / "out"


def header(path: Path) -> Any:
    """The header of an image."""
    image = ImageBuf(str(path))
    assert image.initialized, path
    return image.spec()


def video(path: Path) -> tuple[Fraction, Fraction | None]:
    """The frame rate and the pixel aspect ratio of a video."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert stream.average_rate is not None
        return stream.average_rate, stream.sample_aspect_ratio


def test_the_pixel_aspect_ratio_is_kept_in_every_format(tmp_path: Path) -> None:
    formats = [word for name in ("exr", "png", "tif", "mp4") for word in ("--format", name)]
    out = results(tmp_path, {"PixelAspectRatio": 2.0}, *formats)
    for name in ("exr", "png", "tif"):
        assert header(out / name / f"s.0002.{name}")["PixelAspectRatio"] == pytest.approx(2.0)
    assert video(out / "video.mp4")[1] == 2


def test_square_pixels_are_not_stated_in_png(tmp_path: Path) -> None:
    out = results(tmp_path, {"owner": "me"}, "--format", "png")
    assert header(out / "s.0002.png").getattribute("XResolution") is None


def test_the_pixel_aspect_ratio_of_unequal_ratios_is_that_of_the_image(tmp_path: Path) -> None:
    size = header(write_renders(tmp_path / "in", {1: "s.0001"}) / "s.0001.exr")
    wide = f"{4 * size.width}x{2 * size.height}"
    out = results(tmp_path, {"PixelAspectRatio": 2.0}, "--display-size", wide)
    assert header(out / "s.0002.exr")["PixelAspectRatio"] == 1.0
    rounded = f"{2 * size.width + 1}x{2 * size.height}"
    upscale(tmp_path / "in", tmp_path / "odd", *OURS, "--display-size", rounded)
    assert header(tmp_path / "odd" / "s.0002.exr")["PixelAspectRatio"] == 2.0


def test_the_frame_rate_of_the_header_is_that_of_film_and_images(tmp_path: Path) -> None:
    metadata: Metadata = {"framesPerSecond": FILM, "smpte:TimeCode": TIME}
    out = results(tmp_path, metadata, "--format", "exr", "--format", "mp4")
    assert video(out / "video.mp4")[0] == Fraction(24000, 1001)
    image = header(out / "s.0002.exr")
    assert image.getattribute("framesPerSecond") == FILM.values
    assert image.getattribute("smpte:TimeCode") == TIME.values


def test_a_frame_rate_that_is_given_replaces_that_of_the_header_and_its_time_code(tmp_path: Path) -> None:
    metadata: Metadata = {"framesPerSecond": FILM, "smpte:TimeCode": TIME, "comments": "night"}
    out = results(tmp_path, metadata, "--format", "exr", "--format", "mp4", "--frame-rate", "30")
    assert video(out / "video.mp4")[0] == 30
    image = header(out / "s.0002.exr")
    assert image.getattribute("framesPerSecond") == (30, 1)
    assert image.getattribute("smpte:TimeCode") is None
    assert image["ImageDescription"] == "night"


@pytest.mark.parametrize("values", [(0, 1), (24, 0), (-24, 1), (2000000, 1)])
def test_a_header_without_a_usable_rate_leaves_the_default(tmp_path: Path, values: tuple[int, int]) -> None:
    metadata: Metadata = {"framesPerSecond": TypedValues("rational", values)}
    write_renders(tmp_path, {1: "s.0001"}, metadata=metadata)
    assert open_source(tmp_path, conventions=Conventions()).frame_rate == 24.0


def test_entries_of_the_file_that_was_read_are_not_copied(tmp_path: Path) -> None:
    metadata: Metadata = {
        "multiView": TypedValues("string[2]", ("right", "left")),
        "view": "right",
        "textureformat": "Plain Texture",
        "wrapmodes": "black,black",
        "originalDataWindow": TypedValues("box2i", (0, 0, 3, 4)),
        "XResolution": 72.0,
        "acesImageContainerFlax": 1,  # see below
        "owner": "me",
        "screenWindowWidth": 1.5,
    }
    write_renders(tmp_path / "in", {1: "s.0001"}, metadata=metadata)
    path = tmp_path / "in" / "s.0001.exr"  # OpenImageIO writes the flag of ACES' containers in those only
    path.write_bytes(path.read_bytes().replace(b"ContainerFlax", b"ContainerFlag"))
    assert header(path).getattribute("acesImageContainerFlag") == 1
    upscale(tmp_path / "in", tmp_path / "out", *OURS)
    copy_shot(open_source(tmp_path / "in", conventions=Conventions()), tmp_path / "copy")
    for image in (header(tmp_path / "out" / "s.0001.exr"), header(tmp_path / "copy" / "0000.exr")):
        kept = {"Copyright", "screenWindowWidth"}
        names = {entry.name for entry in image.extra_attribs}
        assert names & {*metadata, *kept, "acesImageContainerFlag"} == kept
        assert (image["Copyright"], image["screenWindowWidth"]) == ("me", 1.5)


def test_other_views_of_a_stereo_file_are_not_read(tmp_path: Path) -> None:
    eyes = {"R": 1, "G": 1, "B": 1, "Z": 1, "motion.X": 1, "motion.Y": 1, "A": 1}
    eyes |= {"left.R": 9, "left.G": 9, "left.B": 9, "left.A": 9, "depth.left.Z": 9, "motion.left.X": 9}
    channels = {name: np.full((6, 8), value, np.float32) for name, value in eyes.items()}
    metadata: Metadata = {"multiView": TypedValues("string[2]", ("right", "left"))}
    write_exr(tmp_path / "s.0001.exr", channels, metadata=metadata)
    for opened in (open_source, import_named_channels):
        shot = opened(tmp_path, conventions=Conventions())
        assert (shot.info.aov_names, len(shot.ignored_channels)) == (("A",), 6)
        raw = shot.read_raw(0)
        assert raw.color is not None
        assert (raw.color == 1).all()
        assert (raw.depth == 1).all()
