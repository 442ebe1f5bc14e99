"""Tests of videos: they are decoded again by PyAV and compared with the images."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from supersampler import ArgumentError, ShotError
from supersampler.io import video
from supersampler.io.images import exact_rate
from supersampler.io.video import video_writer

av = pytest.importorskip("av")

COLORS = np.array(
    [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255], [0, 0, 0], [128, 128, 128], [180, 90, 30]],
    np.uint8,
)


def patches(side: int = 32) -> Any:
    """Return a row of squares, one of each colour."""
    return np.repeat(np.repeat(COLORS[None], side, axis=0), side, axis=1)


def gradient(size: tuple[int, int], number: int) -> Any:
    """Return a smooth image that differs from frame to frame."""
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    return np.stack([x + 8 * number, y, 0 * x + 60], axis=-1).astype(np.uint8)


def write(path: Path, images: list[Any], rate: float = 24.0, size: tuple[int, int] = (96, 64)) -> None:
    with video_writer(path, size, rate) as writer:
        for image in images:
            writer.write(image)


def decoded(path: Path) -> tuple[Any, list[Any]]:
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        images = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        return stream, images


def test_a_video_has_the_images_in_order_at_their_size_and_rate(tmp_path: Path) -> None:
    images = [gradient((96, 64), number) for number in range(7)]
    write(tmp_path / "new" / "a.mp4", images, 23.976)
    stream, found = decoded(tmp_path / "new" / "a.mp4")
    assert len(found) == 7
    assert (stream.width, stream.height, stream.average_rate) == (96, 64, Fraction(24000, 1001))
    assert stream.duration * stream.time_base == 7 / Fraction(24000, 1001)
    for image, decoded_image in zip(images, found, strict=True):
        assert np.abs(decoded_image.astype(int) - image).mean() < 2


def test_colours_stay_as_they_are_and_are_tagged_as_bt709(tmp_path: Path) -> None:
    path, image = tmp_path / "a.mp4", patches()
    write(path, [image], size=(image.shape[1], image.shape[0]))
    stream, _ = decoded(path)
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
    _, (found,) = decoded(tmp_path / "a.mp4")
    assert found.shape == (64, 96, 3)
    assert np.abs(found[:63, :95].astype(int) - image).mean() < 3
    assert np.abs(found[-1].astype(int) - 200).mean() < 8


@pytest.mark.parametrize(
    ("rate", "wanted"),
    [
        (24, Fraction(24)),
        (1, Fraction(1)),
        (23.976, Fraction(24000, 1001)),
        (23.98, Fraction(24000, 1001)),
        (29.97, Fraction(30000, 1001)),
        (59.94005994, Fraction(60000, 1001)),
        (12.5, Fraction(25, 2)),
    ],
)
def test_rates_are_exact_fractions(rate: float, wanted: Fraction) -> None:
    assert exact_rate(rate) == wanted


def test_a_video_that_fails_leaves_the_older_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    path.write_bytes(b"older")
    with pytest.raises(ArgumentError, match=r"image is .*; want \(64, 96, 3\) uint8"):
        write(path, [gradient((96, 64), 0), gradient((64, 64), 1)])
    with pytest.raises(ArgumentError, match="frames is none"):
        write(path, [])
    assert path.read_bytes() == b"older"
    assert list(tmp_path.iterdir()) == [path]


def test_a_missing_encoder_and_a_wrong_rate_are_refused_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ArgumentError, match="frame_rate is 0"):
        write(tmp_path / "a.mp4", [], rate=0)
    monkeypatch.setattr(video, "_CODEC", "libx999")
    missing = r"a\.mp4: cannot be written: this PyAV has no encoder libx999\. Install PyAV"
    with pytest.raises(ShotError, match=missing):
        write(tmp_path / "a.mp4", [])
    assert not list(tmp_path.iterdir())


def test_a_size_that_the_encoder_refuses_and_a_folder_that_is_a_file_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(ShotError, match=r"a\.mp4: cannot be written \(.+\)"):
        write(tmp_path / "a.mp4", [np.zeros((2, 40000, 3), np.uint8)], size=(40000, 2))
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(ShotError, match="cannot be written"):
        write(tmp_path / "file" / "a.mp4", [])
