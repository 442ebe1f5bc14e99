"""`History`, the state between steps; `StepResult`, the outputs of a step; `Stats` of an Upscaler."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from numpy.typing import NDArray

from supersampler.backends.base import Buffers
from supersampler.errors import ArgumentError, shown
from supersampler.frame import Float32, Size
from supersampler.methods.array_spec import ArraySpec, checked_arrays, values_of
from supersampler.methods.at_rest import check_history
from supersampler.methods.model_info import ModelInfo

AOVS = "history.aovs"


@dataclass(eq=False)
class History:
    """The state that a step passes to the next one, in the format of the model's executor.

    Attributes:
        display_size: (width, height) of the images.
        render_size: (width, height) of the frame that the step upscaled.
        buffers: buffers of the executor.
        aovs: (1, k, H, W) float32 blended AOVs; None if they were not requested.
        kind: identifies the model; a model accepts only histories of its own kind.
    """

    display_size: Size
    render_size: Size
    buffers: Buffers
    aovs: Float32 | None = None
    kind: Any = None


def check_histories(
    history: History, next_history: History | None, kind: object, fits: Callable[[Buffers, Size, Size], bool]
) -> None:
    """Raise ArgumentError unless a step may read `history` and write to `next_history`.

    Args:
        history: the history to read.
        next_history: the history to write to; None if the step allocates it.
        kind: kind of the model.
        fits: see `Executor.fits`.
    """
    written = history if next_history is None else next_history
    for name, given in (("history", history), ("history_out", written)):
        if not isinstance(given, History) or given.kind != kind:
            hint = "`first_history`, `run` and `load_history` of the model make one."
            raise ArgumentError(name, got=shown(given), want="a History of this model", hint=hint)
    if not fits(history.buffers, history.display_size, history.render_size):
        got = f"changed: it is not of {history.display_size} and {history.render_size}"
        raise ArgumentError("history", got=got, want="as it was made")
    if next_history is not None and next_history.buffers is history.buffers:
        raise ArgumentError("history_out", got="history itself", want="other buffers")


@dataclass(frozen=True, eq=False)
class StepResult:
    """The outputs of a step; those that were not requested are None.

    Attributes:
        image: (H, W, 3) float32 linear RGB.
        aovs: (H, W, k) float32 AOVs of the frame, blended with the weights of the image.
        class_map: (H / 2, W / 2, 6) float32, sizes rounded up: class probabilities of each 2x2 pixels. Three
            classes of ghosting: no ghost, disocclusion, changed light; three of aliasing: none, edge, fine
            detail.
        weight: (H, W) float32 weight of the history in the image, [0, 1].
        count: (H, W) float32 number of samples that each pixel has accumulated.
        converged: (H, W) float32 1 where the image is frozen, else 0: it is the mean of one jitter period of
            samples, and stays the same, bit for bit, until something moves or changes there.
    """

    image: Float32
    aovs: Float32 | None = None
    class_map: Float32 | None = None
    weight: Float32 | None = None
    count: Float32 | None = None
    converged: Float32 | None = None


def checked_history(info: ModelInfo, arrays: object, display: Size, render: Size) -> dict[str, NDArray[Any]]:
    """Return the arrays of `Model.save_history` after a check of their names, types, shapes and values.

    Args:
        info: the model.
        arrays: arrays by name.
        display: (width, height) of the images.
        render: (width, height) of the previous frame.

    Raises:
        ArgumentError: an array is missing, unknown, or of a wrong type, shape or range.
    """
    specs = {
        h.input.name: h.input.spec_for(render=render, display=display, previous=render) for h in info.history
    }
    names = {name for name in arrays if isinstance(name, str)} if isinstance(arrays, Mapping) else set()
    if AOVS in names:
        specs[AOVS] = ArraySpec("float32", (1, "k", *display[::-1]), values_of(AOVS))

    def refusal(got: str, want: str) -> ArgumentError:
        return ArgumentError("state", got=got, want=want)

    checked = checked_arrays(arrays, specs, refusal)
    if info.converges:
        check_history(checked, refusal)
    return checked


@dataclass(frozen=True)
class Stats:
    """Counts and times of all steps of an Upscaler.

    Attributes:
        frames: number of frames, shaded or not.
        extrapolated: number of unshaded frames among them.
        resets: number of frames without a history, the first one included.
        seconds: wall time of the steps, without extrapolation.
        extrapolation_seconds: wall time of extrapolating the colour of unshaded frames.
        converged: fraction of the image, in [0, 1], that is frozen after the last frame: it stays the same
            until something moves or changes. At 1 a viewer may stop rendering. None where the method does
            not converge.
    """

    frames: int = 0
    extrapolated: int = 0
    resets: int = 0
    seconds: float = 0.0
    extrapolation_seconds: float = 0.0
    converged: float | None = 0.0

    def after_step(
        self,
        *,
        fresh: bool,
        seconds: float,
        extrapolation_seconds: float | None = None,
    ) -> "Stats":
        """Return the stats after one more step.

        Args:
            fresh: whether the step had no history.
            seconds: wall time of the step.
            extrapolation_seconds: wall time of extrapolating the frame's colour; None for a shaded frame.
        """
        return replace(
            self,
            frames=self.frames + 1,
            extrapolated=self.extrapolated + (extrapolation_seconds is not None),
            extrapolation_seconds=self.extrapolation_seconds + (extrapolation_seconds or 0.0),
            resets=self.resets + fresh,
            seconds=self.seconds + seconds,
        )
