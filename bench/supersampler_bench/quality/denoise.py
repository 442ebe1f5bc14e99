"""Measure the temporal denoiser on a path tracer's frames, beside the per-frame denoiser."""

import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np

from supersampler import ArgumentError, Shot, ShotError
from supersampler.conventions.encodings import srgb_encoded
from supersampler.denoising.oidn import FrameDenoiser, Guides
from supersampler.denoising.sequence import BUFFERS, TemporalDenoiser
from supersampler.denoising.spec import REACH
from supersampler.frame import Float32, Frame
from supersampler.io.display import ExposureMeter, missing_pixels
from supersampler.sequence.backward_motion import scattered_motion
from supersampler_bench.quality import denoise_record, metrics
from supersampler_bench.quality.denoise_references import (
    Reference,
    bounding_box,
    read_reference,
)
from supersampler_bench.quality.scores import BORDER
from supersampler_bench.record import DENOISER

COSTS_FILE = "costs.jsonl"
"""File beside the frames with the renderer's time: lines {"frame": number, "cpu": seconds}."""
Images = dict[int, Float32]
"""Images by frame number."""


class _Cost(msgspec.Struct):
    frame: int
    cpu: float


def scene_and_samples(render: Path) -> tuple[str, int]:
    """Return a render's scene and samples per pixel from the name of its folder: room-4 gives ("room", 4).

    Raises:
        ArgumentError: the name does not end in a hyphen and a number.
    """
    found = re.fullmatch(r"(.+)-(\d+)", render.name)
    if found is None:
        hint = "Rename the folder, or pass a symbolic link of such a name."
        raise ArgumentError("RENDER", got=render.name, want="SCENE-SAMPLES, such as room-4", hint=hint)
    return found[1], int(found[2])


def measure_render(
    render: Path,
    shot: Shot,
    files: Mapping[int, Sequence[Path]],
    denoiser: FrameDenoiser | None,
    *,
    on_frame: Callable[[], None] = lambda: None,
) -> denoise_record.RenderRow:
    """Denoise the frames of a folder in several ways, and score those that have references.

    The shot is opened with the guides of denoising; `files` are its references by `find_references`.
    `denoiser` denoises each frame first; None: frames are already denoised.

    Raises:
        ArgumentError: the folder has another name, or no frame has a reference.
        ShotError: a file cannot be read; a reference differs in size from the frames, or none of its pixels
            can be scored.
    """
    scene, samples = scene_and_samples(render)
    span = span_of(shot, files)
    numbers = [shot.first_number + index for index in span]
    references = {number: read_reference(files[number], denoiser) for number in numbers if number in files}
    width, height = shot.render_size
    for number, each in references.items():
        if each.scored.shape != (height, width):
            raise ShotError(files[number][0], f"has {each.scored.shape} pixels; the frames {(height, width)}")
        if not each.scored.any():
            problem = f"has no pixel that is {BORDER} pixels from missing ones and from the edge"
            raise ShotError(files[number][0], problem, "Render a larger region.")
    frames = _frames(shot, span)
    metered = None if denoiser is None else Metered(denoiser)
    both, filter_cpu = _denoised(frames, metered, REACH, samples, on_frame)
    singles = frames if metered is None else metered.singles(frames)
    one_pass, one_pass_cpu = _denoised(singles, None, 0, samples)
    by_number = dict(zip(numbers, singles, strict=True))
    images: dict[str, Images] = {
        denoise_record.FRAME: {
            number: np.asarray(by_number[number].color, np.float32) for number in references
        },
        denoise_record.MEDIAN: {number: median_of_three(by_number, number) for number in references},
        denoise_record.ONE_PASS: {number: one_pass[number - numbers[0]] for number in references},
        DENOISER: {number: both[number - numbers[0]] for number in references},
    }
    return denoise_record.RenderRow(
        scene=scene,
        samples=samples,
        size=shot.render_size,
        frames=numbers,
        reference_frames=list(references),
        reference_files=min(len(files[number]) for number in references),
        reference_is_denoised=all(each.is_denoised for each in references.values()),
        scored=float(np.mean([each.scored.mean() for each in references.values()])),
        per_frame="none" if denoiser is None else "oidn",
        render_cpu=render_cost(render, numbers),
        frame_cpu=0.0 if metered is None else metered.frame_cpu / len(frames),
        mean_cpu=0.0 if metered is None else metered.mean_cpu / len(frames),
        filter_cpu=filter_cpu,
        one_pass_cpu=one_pass_cpu,
        methods=[_scores(method, found, references) for method, found in images.items()],
    )


def span_of(shot: Shot, references: Mapping[int, object]) -> range:
    """Return the indices of the frames from REACH before the first reference to REACH after the last.

    Raises:
        ArgumentError: no frame has a reference.
    """
    indices = [index for index in range(len(shot)) if shot.first_number + index in references]
    if not indices:
        numbers = f"{shot.first_number} to {shot.first_number + len(shot) - 1}"
        got = f"references of the frames {', '.join(map(str, references))}"
        raise ArgumentError("--reference", got=got, want=f"some of the frames {numbers} of {shot.name}")
    return range(max(0, indices[0] - REACH), min(len(shot), indices[-1] + REACH + 1))


def render_cost(render: Path, numbers: Sequence[int]) -> float | None:
    """Return the renderer's mean CPU seconds over the frames; None if COSTS_FILE has none of them.

    Raises:
        ShotError: the file has other lines.
    """
    path = render / COSTS_FILE
    if not path.is_file():
        return None
    try:
        lines = [line for line in path.read_bytes().splitlines() if line.strip()]
        costs = [msgspec.json.decode(line, type=_Cost) for line in lines]
    except msgspec.DecodeError as error:
        hint = 'Its lines are {"frame": 1, "cpu": 2.5}.'
        raise ShotError(path, f"is not readable ({error})", hint) from error
    by_number = {cost.frame: cost.cpu for cost in costs}
    return denoise_record.mean_of([by_number.get(number) for number in numbers])


class Metered:
    """Counts the CPU seconds of a denoiser, and keeps the frames that it denoises by themselves."""

    def __init__(self, denoiser: FrameDenoiser) -> None:
        self._denoiser = denoiser
        self.frame_cpu = 0.0  # of frames, with their guides
        self.mean_cpu = 0.0  # of means of frames, which have no guides of their own
        self._guides: Guides | None = None  # of the frame that comes next
        self._singles: list[tuple[Float32, Guides]] = []

    def clean_guides(self, albedo: Float32 | None, normal: Float32 | None) -> Guides:
        """See `FrameDenoiser`."""
        before = time.process_time()
        self._guides = self._denoiser.clean_guides(albedo, normal)
        self.frame_cpu += time.process_time() - before
        return self._guides

    def denoise(self, color: Float32, albedo: Float32 | None, normal: Float32 | None) -> Float32:
        """See `FrameDenoiser`."""
        before = time.process_time()
        image = self._denoiser.denoise(color, albedo, normal)
        seconds = time.process_time() - before
        if self._guides is None:
            self.mean_cpu += seconds
        else:
            self.frame_cpu += seconds
            self._singles.append((image, self._guides))
            self._guides = None
        return image

    def singles(self, frames: Sequence[Frame]) -> list[Frame]:
        """Return the frames with the colour and guides that the denoiser made of each frame alone."""
        done = []
        for frame, (clean, (albedo, normal)) in zip(frames, self._singles, strict=True):
            color = clean * np.float32(frame.pre_exposure)
            color[missing_pixels(np.asarray(frame.color))] = np.nan
            known = {"base_color": albedo, "normal": normal}
            gbuffer = {name: guide for name, guide in known.items() if guide is not None}
            exposure = ExposureMeter().read_frame(frame)  # as `TemporalDenoiser` measures it, with noise
            done.append(replace(frame, color=color, gbuffer=gbuffer or None, exposure=exposure))
        return done


def _frames(shot: Shot, span: range) -> list[Frame]:
    """Return the frames without AOVs; all are read before anything is measured."""
    read = shot.frames(span.start, span.stop, gbuffers=BUFFERS, references=False)
    frames = [replace(item.frame, aovs=None) for item in read]
    frames[0] = replace(frames[0], reset=True)
    return frames


def _denoised(
    frames: Sequence[Frame],
    denoiser: Metered | None,
    lookahead: int,
    samples: int,
    on_frame: Callable[[], None] = lambda: None,
) -> tuple[list[Float32], float]:
    """Return the images, and the filter's CPU seconds per frame that has all neighbours."""
    images, seconds = [], []

    def spent() -> float:
        own = 0.0 if denoiser is None else denoiser.frame_cpu + denoiser.mean_cpu
        return time.process_time() - own

    with TemporalDenoiser(
        per_frame=denoiser or "none", lookahead=lookahead, samples=samples, threads=1
    ) as stages:
        run = stages.run(frames)
        for _ in frames:
            before = spent()
            images.append(next(run).image)
            seconds.append(spent() - before)
            on_frame()
    return images, float(np.mean(seconds[REACH : len(frames) - lookahead] or seconds))


def median_of_three(frames: Mapping[int, Frame], number: int) -> Float32:
    """Return the median (h, w, 3), per channel, of a frame and its two neighbours.

    The neighbours are aligned by motion, bilinearly. The frame itself replaces unknown pixels of them.
    """
    frame, before, after = (frames.get(each) for each in (number, number - 1, number + 1))
    if frame is None or frame.color is None:
        raise ArgumentError("frames", got=f"none of number {number}", want="its colour")
    own = np.asarray(frame.color, np.float32)
    images = [own]
    for other, motion in _neighbours(frame, before, after):
        warped, inside = metrics.warp(np.asarray(other.color, np.float32), np.asarray(motion, np.float32))
        known = inside[..., None] & ~np.isnan(warped)
        images.append(np.where(known, warped, own).astype(np.float32))
    images += [own] * (3 - len(images))
    return np.asarray(np.median(images, axis=0), np.float32)


def _neighbours(frame: Frame, before: Frame | None, after: Frame | None) -> Iterator[tuple[Frame, Float32]]:
    if before is not None and not frame.reset:
        yield before, np.asarray(frame.motion, np.float32)
    if after is not None and not after.reset:
        given = frame.motion_next
        motion = scattered_motion(frame, after) if given is None else given
        yield after, np.asarray(motion, np.float32)


def displayed(image: Float32) -> Float32:
    """Return linear RGB as sRGB: clipped to [0, 1] and encoded, without exposure or tone curve."""
    return srgb_encoded(np.clip(np.nan_to_num(image, nan=0.0, posinf=1.0), 0.0, 1.0))


def _scores(method: str, images: Images, references: Mapping[int, Reference]) -> denoise_record.DenoiseScores:
    """Score the images of one method in the smallest rectangle around the scored pixels."""
    box = bounding_box(np.logical_or.reduce([each.scored for each in references.values()]))
    masks = {number: each.scored[box] for number, each in references.items()}
    shown = {number: displayed(image[box]) for number, image in images.items()}
    truth = {number: displayed(each.color[box]) for number, each in references.items()}
    flip: list[float] = []
    if find_spec("flip_evaluator") is not None:
        for number, mask in masks.items():
            error = metrics.flip_map(shown[number], truth[number])
            flip.append(float(error[mask].mean(dtype=np.float64)))
    changes: list[float | None] = [
        metrics.tpsnr(shown[b], shown[a], truth[b], truth[a], masks[a] & masks[b])
        for a, b in pairwise(sorted(references))
        if b == a + 1
    ]
    psnr = [metrics.psnr(shown[number], truth[number], masks[number]) for number in references]
    return denoise_record.DenoiseScores(method, psnr, denoise_record.mean_of(changes), flip)
