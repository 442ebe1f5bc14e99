"""What a step takes from the one before, and what it gives beside an image."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from numpy.typing import NDArray

from supersampler.backends.base import Buffers
from supersampler.backends.cpu.tile_state import tile_state_specs
from supersampler.errors import ArgumentError, shown
from supersampler.frame import Float32, Size
from supersampler.methods.array_spec import ArraySpec, checked_arrays, values_of
from supersampler.methods.model_file import ModelInfo

AOVS = "history.aovs"
WORK = "work"


@dataclass(eq=False)
class History:
    """What one frame leaves for the next, in the form that its model's executor has it.

    Attributes:
        display_size: (width, height) of the images that it belongs to.
        render_size: (width, height) of the frame that left it.
        buffers: the executor's.
        carry: (1, k, H, W) what the frame carried along; None where it was not asked for.
        kind: what it is the history of: a model takes those of its own kind alone.
    """

    display_size: Size
    render_size: Size
    buffers: Buffers
    aovs: Float32 | None = None
    kind: Any = None


def check_histories(
    past: History, left: History | None, kind: object, fits: Callable[[Buffers, Size, Size], bool]
) -> None:
    """Raise ArgumentError unless a step may read one history and write to another.

    Args:
        past: to read.
        left: to write to; None where room is made.
        kind: what the executor takes.
        fits: of the executor.
    """
    for name, history in {"history": past, **({} if left is None else {"history_out": left})}.items():
        if not isinstance(history, History) or history.kind != kind:
            hint = "`first_history`, `run` and `load_history` of the model make one."
            raise ArgumentError(name, got=shown(history), want="a History of this model", hint=hint)
    if not fits(past.buffers, past.display_size, past.render_size):
        got = f"changed: it is not of {past.display_size} and {past.render_size}"
        raise ArgumentError("history", got=got, want="as it was made")
    if left is not None and left.buffers is past.buffers:
        raise ArgumentError("history_out", got="history itself", want="other buffers")


@dataclass(frozen=True, eq=False)
class StepResult:
    """An image, and what else was asked for; what was not is None.

    Attributes:
        image: (H, W, 3) float32 linear RGB.
        carry: (H, W, k) float32 what the frame carries along, blended as the image is.
        class_map: (H / 2, W / 2, 6) float32, sizes rounded up: shares of each 2x2 pixels' classes. None of a
            past, hidden before, changed light; then no aliasing, of an edge, of fine detail.
        weight: (H, W) float32 share of the past in the image, [0, 1].
        count: (H, W) float32 how many samples the image is worth.
        work: (H / 32, W / 32) float32, sizes rounded up: share of a whole step's work that was done in each
            tile of 32x32 pixels.
    """

    image: Float32
    aovs: Float32 | None = None
    class_map: Float32 | None = None
    weight: Float32 | None = None
    count: Float32 | None = None
    work: Float32 | None = None


def checked_history(info: ModelInfo, arrays: object, display: Size, render: Size) -> dict[str, NDArray[Any]]:
    """Return the arrays of a saved history after a check of each: see `Model.save_history`.

    Args:
        info: the model.
        arrays: by name.
        display: (width, height) of the images.
        render: (width, height) of the frame that left it.

    Raises:
        ArgumentError: an array is missing, unknown, or not of the type, shape and range that the model names.
    """
    specs = {
        h.input.name: h.input.spec_for(render=render, display=display, previous=render) for h in info.history
    }
    names = {name for name in arrays if isinstance(name, str)} if isinstance(arrays, Mapping) else set()
    if AOVS in names:
        specs[AOVS] = ArraySpec("float32", (1, "k", *display[::-1]), values_of(AOVS))
    specs |= tile_state_specs(names, display, render)
    return checked_arrays(arrays, specs, lambda got, want: ArgumentError("state", got=got, want=want))


@dataclass(frozen=True)
class Stats:
    """What an Upscaler has done since it was made.

    Attributes:
        frames: frames stepped.
        extrapolated: those of them that were not shaded.
        resets: times that the history was dropped, the first frame's included.
        seconds: wall time spent in steps, without drawing the colour of frames that were not shaded.
        extrapolation_seconds: wall time spent on that.
        work: of the work that drawing every pixel of every frame is, how many frames' worth was done; a
            `frames - work` was skipped.
        full_frames: frames of which every pixel was drawn.
        full_seconds: wall time spent on those.
    """

    frames: int = 0
    extrapolated: int = 0
    resets: int = 0
    seconds: float = 0.0
    extrapolation_seconds: float = 0.0
    work: float = 0.0
    full_frames: int = 0
    full_seconds: float = 0.0

    def after_step(
        self, *, fresh: bool, work: float, seconds: float, extrapolation_seconds: float | None = None
    ) -> "Stats":
        """Return these with one more step.

        Args:
            fresh: whether it had no past.
            work: share of a whole step's that was done.
            seconds: that it took.
            extrapolation_seconds: that the frame's colour took before; None where it was shaded.
        """
        full, extrapolated = work == 1.0, extrapolation_seconds is not None
        return replace(
            self,
            frames=self.frames + 1,
            extrapolated=self.extrapolated + extrapolated,
            extrapolation_seconds=self.extrapolation_seconds + (extrapolation_seconds or 0.0),
            resets=self.resets + fresh,
            seconds=self.seconds + seconds,
            work=self.work + work,
            full_frames=self.full_frames + full,
            full_seconds=self.full_seconds + (seconds if full else 0.0),
        )

    @property
    def saved_seconds(self) -> float:
        """What all frames would have taken at the pace of the full ones, less what they took."""
        if not self.full_frames:
            return 0.0
        return self.full_seconds / self.full_frames * self.frames - self.seconds
