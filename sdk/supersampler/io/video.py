"""Write an H.264 video in an mp4 file, image by image, by PyAV (the extra `video`).

>>> with video_writer("out.mp4", (1920, 1080), 23.976) as video:
...     for image in images:
...         video.write(to_uint8(transform.show(image)))
"""

from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from supersampler.errors import ArgumentError, ShotError, shown
from supersampler.frame import Size
from supersampler.io.files import NO_ROOM, replacing
from supersampler.io.images import Bytes, exact_rate

if TYPE_CHECKING:
    from av.container import OutputContainer
    from av.video.stream import VideoStream

_CODEC: Literal["libx264"] = "libx264"
# "crf" is x264's constant rate factor: nearly no visible loss. With B-frames it does not always write the
# same bytes for the same images, and a run that was stopped would end with another video.
_OPTIONS = {"crf": "16", "bf": "0"}
_BT709, _VIDEO_RANGE = 1, 1  # numbers of ITU-T H.273, and FFmpeg's of the range 16 to 235


class VideoWriter:
    """Encodes the images of one video, in order; made by `video_writer`."""

    def __init__(self, container: "OutputContainer", stream: "VideoStream", size: Size) -> None:
        self._container, self._stream, self._size = container, stream, size
        self.frames = 0

    def write(self, image: Bytes) -> None:
        """Encode the next image.

        Args:
            image: (h, w, 3) uint8, as it is shown (sRGB or the view's encoding).

        Raises:
            ArgumentError: it has another type, or not the size of the video.
            ShotError: the disk refused, or the encoder did.
        """
        from av import VideoFrame
        from av.video.reformatter import ColorRange, Colorspace

        width, height = self._size
        if image.shape != (height, width, 3) or image.dtype != np.uint8:
            raise ArgumentError("image", got=shown(image), want=f"({height}, {width}, 3) uint8")
        even = np.pad(image, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
        frame = VideoFrame.from_ndarray(even, format="rgb24").reformat(
            format="yuv420p", dst_colorspace=Colorspace.ITU709, dst_color_range=ColorRange.MPEG
        )
        frame.pts = self.frames
        self._container.mux(self._stream.encode(frame))
        self.frames += 1


@contextmanager
def video_writer(
    path: Path | str, size: Size, frame_rate: float, pixel_aspect: float = 1.0
) -> Iterator[VideoWriter]:
    """Write a video: H.264, yuv420p, matrix and tags of BT.709.

    The file appears when the block ends without an error; until then an older one stays.

    Args:
        path: the file; its folder is created where it is missing.
        size: (width, height) of the images. H.264 needs an even size: the last column or row of an odd one is
            repeated.
        frame_rate: frames a second, 0.001 to 1000; see `exact_rate`.
        pixel_aspect: width of a pixel over its height.

    Raises:
        ModuleNotFoundError, ShotError: see `check_encoder`; the disk refused, or PyAV refuses the size.
        ArgumentError: the frame rate is out of its range, or the block has written no image.
    """
    import av

    rate = exact_rate(frame_rate)
    check_video_encoder(path)
    try:
        with (
            replacing(path) as partial,
            av.open(str(partial), "w", format="mp4", options={"movflags": "+faststart"}) as container,
        ):
            stream = container.add_stream(_CODEC, rate=rate, options=_OPTIONS)
            stream.width, stream.height = (side + side % 2 for side in size)
            stream.pix_fmt = "yuv420p"
            context = stream.codec_context
            context.color_primaries = context.color_trc = context.colorspace = _BT709
            context.color_range = _VIDEO_RANGE
            context.sample_aspect_ratio = Fraction(pixel_aspect).limit_denominator(1001)
            video = VideoWriter(container, stream, size)
            yield video
            if not video.frames:
                raise ArgumentError("frames", got="none", want="at least one image in a video")
            container.mux(stream.encode(None))
    except av.FFmpegError as error:
        raise ShotError(path, f"cannot be written ({error.strerror})", NO_ROOM) from error


def check_video_encoder(path: Path | str) -> None:
    """Check that a video can be encoded.

    Raises:
        ModuleNotFoundError: PyAV is not installed.
        ShotError: PyAV has no H.264 encoder; `path` is the file that was to be written.
    """
    import av

    if _CODEC not in av.codecs_available:
        hint = "Install PyAV from PyPI: pip install supersampler[video]."
        raise ShotError(path, f"cannot be written: this PyAV has no encoder {_CODEC}", hint)
