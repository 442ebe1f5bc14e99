"""Tests of videos: they are decoded again by PyAV and compared with the images."""

from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from OpenImageIO import ImageBuf, ImageSpec

from exr_parts import write_parts
from supersampler import ArgumentError, Conventions, ShotError
from supersampler.io.images import Metadata, TypedValues, exact_rate, write_exr
from supersampler.io.shot import copy_shot, import_named_channels, open_source
from supersampler.io.video import video_writer
from upscale_runs import OURS, upscale, write_renders

av = pytest.importorskip("av")

COLORS = np.array(
    [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255], [0, 0, 0], [128, 128, 128], [180, 90, 30]],
    np.uint8,
)


def gradient(size: tuple[int, int], number: int) -> Any:
    """Return a smooth image that differs from frame to frame."""
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    return np.stack([x + 8 * number, y, 0 * x + 60], axis=-1).astype(np.uint8)


def write(path: Path, images: list[Any], rate: float = 24.0, size: tuple[int, int] = (96, 64)) -> None:
    with video_writer(path, size, rate) as writer:
        for image in images:
            writer(image)


@contextmanager
def decoded(path: Path) -> Iterator[tuple[Any, list[Any]]]:
    """Open a video; yields its stream and images."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        yield stream, [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]


def test_a_video_has_the_images_in_order_at_their_size_and_rate(tmp_path: Path) -> None:
    images = [gradient((96, 64), number) for number in range(7)]
    write(tmp_path / "new" / "a.mp4", images, 23.976)
    with decoded(tmp_path / "new" / "a.mp4") as (stream, found):
        assert len(found) == 7
        assert (stream.width, stream.height, stream.average_rate) == (96, 64, Fraction(24000, 1001))
        assert stream.duration * stream.time_base == 7 / Fraction(24000, 1001)
    for image, decoded_image in zip(images, found, strict=True):
        assert np.abs(decoded_image.astype(int) - image).mean() < 2


def test_colours_stay_as_they_are_and_are_tagged_as_bt709(tmp_path: Path) -> None:
    path, image = tmp_path / "a.mp4", np.tile(COLORS.repeat(32, axis=0), (32, 1, 1))
    write(path, [image], size=(image.shape[1], image.shape[0]))
    with decoded(path) as (stream, _):
        context = stream.codec_context
        tags = (context.color_primaries, context.color_trc, context.colorspace, context.color_range)
        assert tags == (1, 1, 1, 1)
        assert context.pix_fmt == "yuv420p"
    with av.open(str(path)) as container:  # by the tags alone: luma and chroma of BT.709, range 16 to 235
        planes = next(container.decode(video=0)).to_ndarray().astype(float)
    height = image.shape[0]
    light = COLORS @ [0.2126, 0.7152, 0.0722]
    np.testing.assert_allclose(planes[:height][16, 16::32], 16 + 219 / 255 * light, atol=2)
    blue = planes[height:].reshape(-1, image.shape[1] // 2)[8, 8::16][: len(COLORS)]
    np.testing.assert_allclose(blue, 128 + 224 / 255 * (COLORS[:, 2] - light) / 1.8556, atol=2)


def test_an_odd_size_repeats_the_last_column_and_row(tmp_path: Path) -> None:
    image = gradient((95, 63), 0)
    image[:, -1], image[-1] = 200, 200
    write(tmp_path / "a.mp4", [image], size=(95, 63))
    with decoded(tmp_path / "a.mp4") as (_, (found,)):
        assert found.shape == (64, 96, 3)
        assert np.abs(found[:63, :95].astype(int) - image).mean() < 3
        assert np.abs(found[-1].astype(int) - 200).mean() < 8


@pytest.mark.parametrize(
    ("rate", "wanted"),
    [
        (24, (24, 1)), (1, (1, 1)), (23.976, (24000, 1001)), (23.98, (24000, 1001)), (29.97, (30000, 1001)),
        (59.94005994, (60000, 1001)), (12.5, (25, 2)),
    ],
)  # fmt: skip
def test_rates_are_exact_fractions(rate: float, wanted: tuple[int, int]) -> None:
    assert exact_rate(rate) == Fraction(*wanted)


def test_a_video_that_fails_leaves_the_older_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    path.write_bytes(b"older")
    with pytest.raises(ArgumentError, match=r"image is .*; want \(64, 96, 3\) uint8"):
        write(path, [gradient((96, 64), 0), gradient((64, 64), 1)])
    with pytest.raises(ArgumentError, match="frames is none"):
        write(path, [])
    assert path.read_bytes() == b"older"
    assert list(tmp_path.iterdir()) == [path]


def test_a_size_that_the_encoder_refuses_and_a_folder_that_is_a_file_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(ShotError, match=r"a\.mp4: cannot be written \(.+\)"):
        write(tmp_path / "a.mp4", [np.zeros((2, 40000, 3), np.uint8)], size=(40000, 2))
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(ShotError, match="cannot be written"):
        write(tmp_path / "file" / "a.mp4", [])


# --- the headers of results: pixel aspect, frame rate, time code, views, and what is not copied ---


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


def rate_and_aspect(path: Path) -> tuple[Fraction, Fraction | None]:
    """The frame rate and the pixel aspect ratio of a video."""
    with av.open(str(path)) as container:
        stream: Any = container.streams.video[0]
        return stream.average_rate, stream.sample_aspect_ratio


def test_the_pixel_aspect_ratio_is_kept_in_every_format(tmp_path: Path) -> None:
    formats = [word for name in ("exr", "png", "tif", "mp4") for word in ("--format", name)]
    out = results(tmp_path, {"PixelAspectRatio": 2.0}, *formats)
    for name in ("exr", "png", "tif"):
        assert header(out / name / f"s.0002.{name}")["PixelAspectRatio"] == pytest.approx(2.0)
    assert rate_and_aspect(out / "video.mp4")[1] == 2


def test_the_pixel_aspect_ratio_of_unequal_ratios_is_that_of_the_image(tmp_path: Path) -> None:
    size = header(write_renders(tmp_path / "in", {1: "s.0001"}) / "s.0001.exr")
    wide = f"{4 * size.width}x{2 * size.height}"
    out = results(tmp_path, {"PixelAspectRatio": 2.0}, "--display-size", wide)
    assert header(out / "s.0002.exr")["PixelAspectRatio"] == 1.0
    rounded = f"{2 * size.width + 1}x{2 * size.height}"
    upscale(tmp_path / "in", tmp_path / "odd", *OURS, "--display-size", rounded)
    assert header(tmp_path / "odd" / "s.0002.exr")["PixelAspectRatio"] == 2.0


@pytest.mark.parametrize(
    ("given", "rate", "code"), [((), FILM.values, TIME.values), (("--frame-rate", "30"), (30, 1), None)]
)
def test_the_frame_rate_is_the_headers_or_a_given_one_without_its_time_code(
    tmp_path: Path, given: tuple[str, ...], rate: Any, code: Any
) -> None:
    metadata: Metadata = {"framesPerSecond": FILM, "smpte:TimeCode": TIME, "comments": "night"}
    out = results(tmp_path, metadata, "--format", "exr", "--format", "mp4", *given)
    assert rate_and_aspect(out / "video.mp4")[0] == Fraction(*rate)
    image = header(out / "s.0002.exr")
    assert image.getattribute("framesPerSecond") == rate
    assert image.getattribute("smpte:TimeCode") == code
    assert image["ImageDescription"] == "night"


@pytest.mark.parametrize("values", [(0, 1), (24, 0), (-24, 1), (2000000, 1)])
def test_a_header_without_a_usable_rate_leaves_the_default(tmp_path: Path, values: tuple[int, int]) -> None:
    metadata: Metadata = {"framesPerSecond": TypedValues("rational", values)}
    image = header(results(tmp_path, metadata) / "s.0002.exr")
    assert image.getattribute("framesPerSecond") == (24, 1)
    assert open_source(tmp_path / "in", conventions=Conventions()).frame_rate == 24.0


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
        "manifest": '{"a": ' + "0" * 9000 + "}",
        "too long": "0" * 70000,
    }
    write_renders(tmp_path / "in", {1: "s.0001"}, metadata=metadata)
    path = tmp_path / "in" / "s.0001.exr"  # OpenImageIO writes the flag of ACES' containers in those only
    path.write_bytes(path.read_bytes().replace(b"ContainerFlax", b"ContainerFlag"))
    assert header(path).getattribute("acesImageContainerFlag") == 1
    upscale(tmp_path / "in", tmp_path / "out", *OURS)
    copy_shot(open_source(tmp_path / "in", conventions=Conventions()), tmp_path / "copy")
    for image in (header(tmp_path / "out" / "s.0001.exr"), header(tmp_path / "copy" / "0000.exr")):
        kept = {"Copyright", "screenWindowWidth", "manifest"}
        names = {entry.name for entry in image.extra_attribs}
        assert names & {*metadata, *kept, "acesImageContainerFlag"} == kept
        assert (image["Copyright"], image["screenWindowWidth"]) == ("me", 1.5)
        assert image["manifest"] == metadata["manifest"]


def test_other_views_of_a_stereo_file_are_not_read(tmp_path: Path) -> None:
    eyes = {"R": 1, "G": 1, "B": 1, "Z": 1, "motion.X": 1, "motion.Y": 1, "A": 1}
    eyes |= {"left.R": 9, "left.G": 9, "left.B": 9, "left.A": 9, "depth.left.Z": 9, "motion.left.X": 9}
    channels = {name: np.full((6, 8), value, np.float32) for name, value in eyes.items()}
    metadata: Metadata = {"multiView": TypedValues("string[2]", ("right", "left"))}
    write_exr(tmp_path / "s.0001.exr", channels, metadata=metadata)
    for opened in (open_source, import_named_channels):
        shot = opened(tmp_path, conventions=Conventions())
        assert (shot.info.aov_names, len(shot.ignored_channels)) == (("A",), 6)
        raw: Any = shot.read_raw(0)
        assert (raw.color == 1).all()
        assert (raw.depth == 1).all()


def test_parts_of_other_views_are_not_read(tmp_path: Path) -> None:
    parts = []
    for value, view, eye in ((1, "left", ""), (9, "right", "2")):
        for name, channels in (("beauty", "RGBA"), ("depth", "Z"), ("motion", "XY"), ("fog", "Y")):
            spec = ImageSpec(8, 6, len(channels), "float")
            spec.channelnames = tuple(channels)
            spec.attribute("oiio:subimagename", f"{name}{eye}")
            spec.attribute("view", view)
            parts.append((spec, np.full((6, 8, len(channels)), value, np.float32)))
    write_parts(tmp_path / "s.0001.exr", *parts)
    shot = open_source(tmp_path, conventions=Conventions())
    raw = shot.read_raw(0)
    assert shot.info.aov_names == ("A", "fog.Y")
    for found in (raw.color, raw.aovs, raw.depth):
        assert found is not None
        assert (found == 1).all()
    assert "beauty2.R" in shot.ignored_channels
