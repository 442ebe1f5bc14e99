"""Denoise a shot into a folder, frame by frame; a stopped run can be resumed."""

import time
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from supersampler import __version__
from supersampler.cli.arguments import size_text
from supersampler.cli.frame_run import EXPOSURE_FRAMES, FrameRun, SteppedFrame
from supersampler.cli.results import PREROLL, Results, settings_of
from supersampler.cli.terminal import rate_text
from supersampler.denoising import sequence
from supersampler.denoising.oidn import has_oidn
from supersampler.denoising.sequence import PerFrame, TemporalDenoiser
from supersampler.denoising.spec import REACH
from supersampler.errors import FrameError, MissingFramesError, ShotError
from supersampler.frame import Frame
from supersampler.history import StepResult
from supersampler.io.compare import compare_layers
from supersampler.io.images import Bytes, Channel, ImageHeader, Metadata
from supersampler.io.shot import Shot
from supersampler.io.shot.id_channels import is_id, is_of_cryptomatte
from supersampler.io.shot.numbered import FrameRange, frames_text
from supersampler.validation import FrameChecker
from supersampler.validation.mistakes import MOTION_ZERO


def copied_ids(shot: Shot) -> list[str]:
    """Return the channels of the frames that EXR results keep unchanged: ids in floating point."""
    if not shot.ignored_channels:
        return []
    header = shot.read_header(0)
    return [
        name
        for name in shot.ignored_channels
        if header.types.get(name) in ("half", "float") and is_id(name, header.cryptomattes)
    ]


def parts_of(
    numbers: FrameRange | None, open_frames: Callable[..., Shot], passes: int
) -> Iterator[tuple[FrameRange | None, Shot, str]]:
    """Yield the frame numbers, the shot and a note of each part of a sequence; missing frames separate parts.

    Args:
        numbers: numbers of the frames to write; None writes all.
        open_frames: opens all frames, or the frames from a first to a last number.
        passes: 1 or 2.

    Raises:
        ShotError: there are no such frames, or they cannot be opened.
    """
    before, after = REACH + EXPOSURE_FRAMES, REACH if passes == 2 else 0  # that images depend on
    try:
        to_open = () if numbers is None else ((numbers.first - before, numbers.last + after),)
        shot = open_frames(*to_open)
    except MissingFramesError as error:
        missing = error
    except ShotError:
        if numbers is not None:
            open_frames((numbers.first, numbers.last))  # an error about the range itself names its numbers
        raise
    else:
        yield numbers, shot, ""
        return
    low, high = missing.present if numbers is None else (numbers.first, numbers.last)
    for number in (low, high):
        if not missing.present[0] <= number <= missing.present[1]:
            open_frames((number, number))  # raises
    parts = list(_parts_between(missing, low, high))
    if not parts:
        raise missing
    for (begin, end), part, note in parts:
        around = max(begin, part.first - before), min(end, part.last + after)
        yield part, open_frames(around), note


def _parts_between(
    missing: MissingFramesError, low: int, high: int
) -> Iterator[tuple[tuple[int, int], FrameRange, str]]:
    """Yield the frames between two gaps: their first and last number, those of a range, and a note.

    `low` and `high` are the numbers of the range.
    """
    begin, note = missing.present[0], ""
    for (first, last), place in [*missing.gaps.items(), ((missing.present[1] + 1, high), "")]:
        if begin <= high and low <= first - 1:
            part = FrameRange(max(begin, low), min(first - 1, high))
            yield (begin, first - 1), part, note if begin > low else ""
        begin, note = last + 1, f"{frames_text(max(first, low), last)} {place}: a cut"


def _cryptomatte_of(header: ImageHeader, ids: Collection[str]) -> dict[str, str]:
    """Return Cryptomatte's entries, `cryptomatte/ID/...`, without layers that have none of these channels."""
    names = {key.split("/")[1]: name for key, name in header.cryptomatte.items() if key.endswith("/name")}
    absent = {key for key, name in names.items() if not any(is_of_cryptomatte(each, [name]) for each in ids)}
    return {key: value for key, value in header.cryptomatte.items() if key.split("/")[1] not in absent}


@dataclass(kw_only=True, eq=False)
class DenoiseRun(FrameRun):
    """One run that denoises a shot.

    Attributes:
        per_frame: denoiser of single frames: "oidn"; "none" for frames that are already denoised; "auto" is
            "none" for a shot that states that, unless it has the colour from before, too, and OIDN is
            installed; otherwise "oidn".
        passes: 1 averages with previous frames; 2 also with following frames.
        lookahead: number of following frames; see `denoise_sequence`.
        samples: samples per pixel; None is what the shot states.
        threads: 0 is one per core.
    """

    per_frame: PerFrame | Literal["auto"] = "auto"
    passes: int = 2
    lookahead: int | None = None
    samples: float | None = None
    threads: int = 0
    activity = "denoising"
    reach = REACH
    _denoiser: TemporalDenoiser = field(init=False)
    _count: int = field(default=0, init=False)
    _reading: int = field(default=0, init=False)  # index of the frame that was read last
    _ids: list[str] | None = field(default=None, init=False)

    def write(self) -> Results:
        """Denoise the frames that are not complete yet, and print a summary; errors: see `write_frames`."""
        if self.denoiser == "oidn":
            self.shot = self.shot.with_noise()
        after = sequence.frames_after(self.passes, self.lookahead)
        samples = sequence.checked_samples(self.shot.samples if self.samples is None else self.samples)
        plan = self.plan_frames(REACH, 2 if after else 1)
        settings = {
            "supersampler": __version__,
            "method": "denoise",
            "per frame": self.denoiser,
            "frames after": after,
            "samples": samples,
            PREROLL: REACH if self.numbers is not None else None,
            **settings_of(self.shot, self.numbers, self.source, self.images),
        }
        with TemporalDenoiser(
            per_frame=self.denoiser, lookahead=after, samples=samples, threads=self.threads
        ) as self._denoiser:
            return self.write_frames(plan, self.shot.render_size, settings)

    @property
    def denoiser(self) -> PerFrame:
        """The denoiser that runs: "oidn" or "none"."""
        if self.per_frame != "auto":
            return self.per_frame
        return "oidn" if not self.shot.is_denoised or (self.shot.noisy_channels and has_oidn()) else "none"

    def _settled(self, count: int) -> int:
        """Return the number of images that later frames do not change."""
        return max(0, count - sequence.frames_after(self.passes, self.lookahead))

    def _step_count(self) -> int:
        return self._plan.stop - self._needed

    def _steps(self, *, references: bool) -> Generator[SteppedFrame]:
        plan, needed = self._plan, self._needed
        names, checker = deque[Sequence[str] | None](), FrameChecker()

        def read() -> Iterator[Frame]:
            for item in self.shot.frames(plan.start, plan.end, gbuffers=sequence.BUFFERS, references=False):
                frame, self._reading = item.frame, item.index
                if item.index == plan.start:
                    frame = replace(frame, reset=True)
                    guides = zip(("albedo", "normal"), sequence.guides_of(frame), strict=True)
                    if missing := [name for name, guide in guides if guide is None]:
                        lost = "edges between surfaces of similar colour may blur"
                        text = f"The frames have no {' and no '.join(missing)}: {lost}."
                        self.console.print(text, soft_wrap=True)
                with self._named(item.index, only=(MOTION_ZERO.kind,)):  # others are of jittered frames
                    checker.check(frame, frame.size)
                if item.index >= needed:
                    names.append(item.raw.aov_names)
                yield frame

        try:
            exposure = self._exposure_at(needed, plan.index(0)) if self._measures_exposure else None
            before = time.perf_counter()
            for index, denoised in enumerate(self._denoiser.run(read(), skip=needed - plan.start), needed):
                if index >= plan.stop:  # later frames are neighbours only
                    return
                reference = self.shot.read_reference(index) if references else None
                frame = denoised.frame
                if index == needed and exposure is not None:
                    frame = replace(frame, exposure=exposure)
                result = StepResult(denoised.image, aovs=denoised.aovs)
                seconds = time.perf_counter() - before
                self._count += 1
                yield SteppedFrame(index, frame, reference, names.popleft(), result, seconds)
                self._count_step(index)
                before = time.perf_counter()
        except FrameError as error:  # in the frame that was read last
            number = self.shot.first_number + self._reading
            raise ShotError(self.shot.path, f"frame {number}: {error}") from error

    def _summary(self, wall: float) -> tuple[int, str]:
        return self._count, f"{self._count} frames in {wall:.1f} s: {rate_text(self._count, wall)}"

    def _facts(self) -> dict[str, str]:
        return {
            "method": "temporal denoiser",
            "size": size_text(self._image_size).replace("x", " × "),
            "denoiser": {"oidn": "Open Image Denoise", "none": "as it came"}[self.denoiser],
        }

    def _layers(self, stepped: SteppedFrame, exposure: float) -> tuple[Mapping[str, Bytes], dict[str, float]]:
        image, reference, transform = stepped.result.image, stepped.reference, self._transform(stepped.frame)
        return compare_layers(stepped.frame, image, reference, exposure, transform=transform)

    def _copied(self, index: int) -> Mapping[str, Channel]:
        ids = self._kept_ids()
        return self.shot.read_channels(index, ids) if ids else {}

    def _metadata(self, index: int) -> Metadata:
        metadata = super()._metadata(index)
        if self._kept_ids():
            metadata |= _cryptomatte_of(self.shot.read_header(index), self._kept_ids())
        return metadata

    def _kept_ids(self) -> list[str]:
        """Return the channels of ids that results keep, which a live render knows from its first frame on."""
        if self._ids is None and self.shot.ignored_channels:
            self._ids = copied_ids(self.shot)
        return self._ids or []
