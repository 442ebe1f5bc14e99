"""Write an H.264 video in an mp4 file, image by image, by PyAV (the extra `video`).

>>> with video_writer("out.mp4", (1920, 1080), 23.976) as video:
...     for image in images:
...         video(to_uint8(transform.show(image)))
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Literal

import numpy as np

from supersampler.errors import ArgumentError, ShotError, shown
from supersampler.frame import Size
from supersampler.io.files import NO_ROOM, replacing
from supersampler.io.images import Bytes, exact_rate

_CODEC: Literal["libx264"] = "libx264"
# "crf" is x264's constant rate factor; at 16 the loss is hardly visible. With B-frames, x264 does not always
# write the same bytes for the same images, so that a resumed run would write another video.
_OPTIONS = {"crf": "16", "bf": "0"}
_BT709, _VIDEO_RANGE = 1, 1  # of ITU-T H.273; FFmpeg's number of the range 16 to 235


@contextmanager
def video_writer(
    path: Path | str, size: Size, frame_rate: float, pixel_aspect: float = 1.0
) -> Iterator[Callable[[Bytes], None]]:
    """Write a video: H.264, yuv420p, matrix and tags of BT.709.

    Yields a function that encodes the next image: (h, w, 3) uint8, as displayed. The file appears when the
    block ends without an error; until then an older file stays.

    Args:
        path: the file; its folder is created if it is missing.
        size: (width, height) of the images. H.264 needs even sizes: an odd size repeats the last column or
            row.
        frame_rate: frames per second, 0.001 to 1000; see `exact_rate`.
        pixel_aspect: width of a pixel over its height.

    Raises:
        ModuleNotFoundError: PyAV is not installed.
        ShotError: PyAV has no H.264 encoder or refuses the size, or the disk refused.
        ArgumentError: the frame rate is out of its range, an image has another size or type, or there is no
            image.
    """
    import av
    from av.video.reformatter import ColorRange, Colorspace

    rate, count, (width, height) = exact_rate(frame_rate), 0, size
    check_video_encoder(path)

    def write(image: Bytes) -> None:
        nonlocal count
        if image.shape != (height, width, 3) or image.dtype != np.uint8:
            raise ArgumentError("image", got=shown(image), want=f"({height}, {width}, 3) uint8")
        even = np.pad(image, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
        frame = av.VideoFrame.from_ndarray(even, format="rgb24").reformat(
            format="yuv420p", dst_colorspace=Colorspace.ITU709, dst_color_range=ColorRange.MPEG
        )
        frame.pts = count
        container.mux(stream.encode(frame))
        count += 1

    try:
        with (
            replacing(path) as partial,
            av.open(str(partial), "w", format="mp4", options={"movflags": "+faststart"}) as container,
        ):
            stream = container.add_stream(_CODEC, rate=rate, options=_OPTIONS)
            stream.width, stream.height = width + width % 2, height + height % 2
            stream.pix_fmt = "yuv420p"
            context = stream.codec_context
            context.color_primaries = context.color_trc = context.colorspace = _BT709
            context.color_range = _VIDEO_RANGE
            context.sample_aspect_ratio = Fraction(pixel_aspect).limit_denominator(1001)
            yield write
            if count == 0:
                raise ArgumentError("frames", got="none", want="at least one image in a video")
            container.mux(stream.encode(None))
    except av.FFmpegError as error:
        raise ShotError(path, f"cannot be written ({error.strerror})", NO_ROOM) from error


def check_video_encoder(path: Path | str) -> None:
    """Raise ShotError if PyAV has no H.264 encoder for the file, ModuleNotFoundError without PyAV."""
    import av

    if _CODEC not in av.codecs_available:
        hint = "Install PyAV from PyPI: pip install supersampler[video]."
        raise ShotError(path, f"cannot be written: this PyAV has no encoder {_CODEC}", hint)
