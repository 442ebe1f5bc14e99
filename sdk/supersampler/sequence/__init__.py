"""`upscale_sequence`: upscaling where later frames are available, by a forward and a backward run.

The runs and their chunks are in both_ways.py, the colour of unshaded frames in interpolation.py.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from supersampler.arguments import AtRest, ExecutorName, Precision, Validate, checked_lookahead, checked_path
from supersampler.frame import Float32, Frame, Size
from supersampler.io.shot import Shot
from supersampler.model import Model
from supersampler.sequence.both_ways import BothWays, ChunkSize, checked_frames, frames_of
from supersampler.upscaler import Upscaler

__all__ = ["upscale_sequence"]

MAX_LOOKAHEAD = 64


def upscale_sequence(
    frames: Shot | Iterable[Frame],
    *,
    display_size: Size | None = None,
    scale: float | None = None,
    model: Model | str | Path | None = None,
    passes: int = 2,
    lookahead: int | None = None,
    providers: str | Sequence[str] = "auto",
    threads: int = 0,
    executor: ExecutorName = "auto",
    precision: Precision = "auto",
    at_rest: AtRest = "converge",
    skip: bool = True,
    extrapolation: str | Path | None = None,
    validate: Validate = "warn",
    scratch: str | Path | None = None,
) -> Iterator[Float32]:
    """Upscale frames whose later frames are available: a shot on disk, or a live stream with a delay.

    With two passes, each image is the mean of a forward and a backward run. The backward run starts at the
    next cut, or 16 frames after a chunk of 64 frames. Surfaces that are disoccluded in one run were visible
    in the other.

    >>> for image in upscale_sequence(Shot.open("plaza"), display_size=(640, 360)):
    ...     show(image)  # (360, 640, 3) float32, linear RGB

    Frames are read once, in order, so a generator works. The frames of a chunk and its backward images are
    kept in memory up to 1 GiB, and beyond that in a scratch file. The file is removed at the end, after an
    error, and when the iterator is closed or deleted.

    Args:
        frames: a `Shot`, or Frames in order. `reset` marks the first frame after a cut.
        display_size: (width, height) of the images; or `scale`.
        scale: display over render size.
        model: see `Upscaler`.
        passes: 1 steps in order, bit for bit as `Upscaler.step`; 2 also runs backward.
        lookahead: for live use, with two passes: number of frames of a chunk, 1 to 64, and of the frames
            after it that are read. An image is delayed by at most 2 * `lookahead` frames and costs three
            steps; frames are kept in memory. None is for frames on disk.
        providers: see `Upscaler`.
        threads: see `Upscaler`.
        executor: see `Upscaler`.
        precision: see `Upscaler`.
        at_rest: see `Upscaler`.
        skip: see `Upscaler`.
        extrapolation: model for frames without colour, such as "guided-warp". One pass extrapolates from the
            previous shaded frame, as `Upscaler.extrapolate`; two passes interpolate to the next one.
        validate: see `Upscaler`.
        scratch: existing folder for the scratch file; None is the system's temporary folder.

    Returns:
        An iterator over the images, (H, W, 3) float32 linear RGB, in order; each may be kept.

    Raises:
        ArgumentError: an argument is invalid; raised before any frame is read.
        FrameError: a frame breaks the contract.
        ShotError: a frame cannot be read, or there is no room for the scratch file.
        ModelError, ProviderError: see `Upscaler`.
    """
    block = checked_lookahead(passes, lookahead, MAX_LOOKAHEAD)
    chunk = ChunkSize(block, block) if block else ChunkSize()
    folder = None if scratch is None else Path(checked_path("scratch", scratch))
    frames = checked_frames(frames)
    forward = Upscaler(
        model, display_size=display_size, scale=scale, providers=providers, threads=threads,
        executor=executor, precision=precision, at_rest=at_rest, skip=skip, validate=validate,
        extrapolation=extrapolation if passes == 1 else None,
    )  # fmt: skip
    if passes == 1:
        return _in_order(frames, forward, extrapolates=extrapolation is not None)
    memory = None if lookahead is None else math.inf
    runs = BothWays(
        forward, chunk, extrapolation=extrapolation, executor=executor, memory=memory, scratch=folder
    )
    return _both_ways(frames, forward, runs)


def _in_order(frames: Shot | Iterable[Frame], forward: Upscaler, *, extrapolates: bool) -> Iterator[Float32]:
    with forward:
        for frame in frames_of(frames, forward.gbuffers):
            unshaded = extrapolates and frame.color is None
            yield forward.extrapolate(frame) if unshaded else forward.step(frame)


def _both_ways(frames: Shot | Iterable[Frame], forward: Upscaler, runs: BothWays) -> Iterator[Float32]:
    with forward:
        for merged in runs.run(frames_of(frames, runs.buffers)):
            yield merged.result.image
