"""`upscale_sequence`: the images of frames whose successors are known."""

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path

from supersampler.arguments import checked_path
from supersampler.errors import ArgumentError, shown
from supersampler.frame import Float32, Frame, Size, checked_frame
from supersampler.io.shot import Shot, ShotFrame
from supersampler.model import AtRest, ExecutorName, Model, Precision
from supersampler.sequence.both_ways import BothWays, ChunkSize
from supersampler.sequence.frame_store import MEMORY, FrameStore
from supersampler.sequence.interpolation import Interpolator, interpolator_of
from supersampler.upscaler import Upscaler
from supersampler.validation import Validate

MOTION_NEXT = "motion_next"
"""Name of that buffer in the `gbuffers` of `Shot.frames`."""
_LONGEST_LOOKAHEAD = 64


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
    """Upscale frames of which later ones can be seen: a shot on disk, or a live stream with some delay.

    With two passes, each image is the mean of a run in order and one in reverse, which begins at the next
    cut or OVERLAP frames after a chunk of CHUNK frames. What one run cannot know, since it was hidden before,
    the other one has seen.

    >>> for image in upscale_sequence(Shot.open("plaza"), display_size=(640, 360)):
    ...     show(image)  # (360, 640, 3) float32, linear RGB

    Frames are read once, in order, so that a generator serves as well as a list or a `Shot`. Those of a chunk
    and its backward images are kept in memory up to 1 GiB, and beyond that in a scratch file, which is
    removed at the end, after an error, and when the iterator is closed or deleted.

    Args:
        frames: a `Shot`, or Frames in order. `reset` marks the first frame after a cut.
        display_size: (width, height) of the images; or `scale`.
        scale: display over render size.
        model: see `Upscaler`.
        passes: 1 steps in order, bit for bit as `Upscaler.step`; 2 runs both ways.
        lookahead: for live use, with two passes: chunks of this many frames, 1 to 64, which see as many
            further frames. The image of a frame comes at most 2 * `lookahead` frames later and costs three
            steps; frames are kept in memory. None is for frames on disk.
        providers: see `Upscaler`.
        threads: see `Upscaler`.
        executor: see `Upscaler`.
        precision: see `Upscaler`.
        at_rest: see `Upscaler`.
        skip: see `Upscaler`.
        extrapolation: model for frames without colour, such as "guided-warp". One pass takes their light from
            the shaded frame before, as `Upscaler.extrapolate`; two passes from those before and after.
        validate: see `Upscaler`.
        scratch: existing folder for the scratch file; None is the system's place for temporary files.

    Returns:
        An iterator over the images, (H, W, 3) float32 linear RGB, in order; each may be kept.

    Raises:
        ArgumentError: an argument is not usable; before anything is read.
        FrameError: a frame breaks the contract.
        ShotError: a frame cannot be read, or there is no room for the scratch file.
        ModelError, ProviderError: see `Upscaler`.
    """
    size = _checked_chunk(passes, lookahead)
    place = None if scratch is None else Path(checked_path("scratch", scratch))
    if not isinstance(frames, Shot) and not isinstance(frames, Iterable):
        raise ArgumentError("frames", got=shown(frames), want="a Shot, or an iterable of Frames")
    forward = Upscaler(
        model, display_size=display_size, scale=scale, providers=providers, threads=threads,
        executor=executor, precision=precision, at_rest=at_rest, skip=skip, validate=validate,
        extrapolation=extrapolation if passes == 1 else None,
    )  # fmt: skip
    if passes == 1:
        return _in_order(frames, forward, extrapolates=extrapolation is not None)
    interpolator = None if extrapolation is None else interpolator_of(extrapolation, forward, executor)
    backward = Upscaler(
        forward.model, display_size=display_size, scale=scale, at_rest=at_rest, skip=skip, validate="off"
    )  # the same frames: one check is enough
    memory = MEMORY if lookahead is None else math.inf
    store = FrameStore(memory=memory, folder=place, names=buffers_of(forward, interpolator))
    return _both_ways(frames, forward, backward, size, interpolator, store)


def buffers_of(upscaler: Upscaler, interpolator: Interpolator | None = None) -> frozenset[str]:
    """Return the names of the buffers that two passes read of each frame, as in `Shot.frames`."""
    return frozenset((*upscaler.gbuffers, *(interpolator.gbuffers if interpolator else ()), MOTION_NEXT))


def frames_of(frames: Shot | Iterable[Frame], names: Collection[str]) -> Iterator[Frame]:
    """Yield the frames of a shot, with these buffers, or those of an iterable, checked."""
    if isinstance(frames, Shot):
        for item in frames.frames(gbuffers=names, references=False):
            yield item.frame
        return
    for frame in frames:
        yield checked_frame(frame.frame if isinstance(frame, ShotFrame) else frame)


def _in_order(frames: Shot | Iterable[Frame], forward: Upscaler, *, extrapolates: bool) -> Iterator[Float32]:
    with forward:
        for frame in frames_of(frames, forward.gbuffers):
            unshaded = extrapolates and frame.color is None
            yield forward.extrapolate(frame) if unshaded else forward.step(frame)


def _both_ways(
    frames: Shot | Iterable[Frame],
    forward: Upscaler,
    backward: Upscaler,
    size: ChunkSize,
    interpolator: Interpolator | None,
    store: FrameStore,
) -> Iterator[Float32]:
    names = buffers_of(forward, interpolator)
    with forward, backward, store:
        runs = BothWays(forward, backward, store, size, interpolator=interpolator)
        for merged in runs.run(frames_of(frames, names)):
            yield merged.result.image


def _checked_chunk(passes: int, lookahead: int | None) -> ChunkSize:
    if type(passes) is not int or passes not in (1, 2):
        raise ArgumentError("passes", got=shown(passes), want="1 or 2")
    if lookahead is None:
        return ChunkSize()
    if passes == 1:
        raise ArgumentError(
            "lookahead", got=shown(lookahead), want="None, as one pass looks at no later frame"
        )
    if type(lookahead) is not int or not 1 <= lookahead <= _LONGEST_LOOKAHEAD:
        want = f"a whole number of frames from 1 to {_LONGEST_LOOKAHEAD}, or None"
        raise ArgumentError("lookahead", got=shown(lookahead), want=want)
    return ChunkSize(lookahead, lookahead)
