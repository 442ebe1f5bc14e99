"""State between steps, as `History` and stored as `State`; `StepResult` and `Stats` of steps."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.base import Buffers
from supersampler.backends.cpu.ids import IdHistory
from supersampler.errors import ArgumentError
from supersampler.frame import Float32, Size

STATE_VERSION = 4
"""Version of the content of a State. Other versions are refused, because arrays may differ in meaning."""


@dataclass(eq=False)
class History:
    """State that a step passes to the next step, in the format of the model's executor.

    Attributes:
        display_size: (width, height) of the images.
        render_size: (width, height) of the last frame.
        buffers: buffers of the executor.
        aovs: (1, k, H, W) float32 blended AOVs; None if they were not requested, or are in `buffers`, where
            the GPU backend keeps them.
        ids: ids at display size; None if they were not requested.
        kind: identity of the model; a model accepts only its own histories.
    """

    display_size: Size
    render_size: Size
    buffers: Buffers
    aovs: Float32 | None = None
    ids: IdHistory | None = None
    kind: Any = None

    def __reduce__(self) -> NoReturn:
        """Refuse copying and pickling: a copy would share the buffers, which belong to a model."""
        hint = "`model.save_history` copies its arrays, and `load_history` takes them."
        raise ArgumentError("history", got="to be copied or pickled", want="used in place", hint=hint)


@dataclass(frozen=True, eq=False)
class StepResult:
    """The outputs of a step; those that were not requested are None.

    Attributes:
        image: (H, W, 3) float32 linear RGB.
        aovs: (H, W, k) float32 AOVs of the frame, blended with the weights of the image.
        ids: (H, W, k) ids of the frame, in their own type. Each pixel has those of one sample: the nearest
            one of this frame; or an earlier one that was nearer to the pixel's centre, if its surface,
            followed by motion, is still among the frame's samples around the pixel.
        class_map: (H / 2, W / 2, 6) float32, sizes rounded up: class probabilities of each block of 2x2
            pixels. Three classes of ghosting: none, disocclusion, changed light; three of aliasing: none,
            edge, fine detail.
        weight: (H, W) float32 weight of the history in the image, [0, 1].
        count: (H, W) float32 number of samples that each pixel has accumulated.
        converged: (H, W) float32, 1 where the image is frozen, else 0. A frozen pixel is the mean of one
            jitter period of samples, and stays the same, bit for bit, until something moves or changes there.
    """

    image: Float32
    aovs: Float32 | None = None
    class_map: Float32 | None = None
    weight: Float32 | None = None
    count: Float32 | None = None
    converged: Float32 | None = None
    ids: NDArray[np.integer[Any]] | None = None


@dataclass(frozen=True)
class Stats:
    """Counts and times of all steps of an Upscaler.

    Attributes:
        frames: number of frames, shaded or not.
        extrapolated: number of unshaded frames among them.
        resets: number of frames without a history, the first one included.
        seconds: wall time of the steps, without extrapolation.
        extrapolation_seconds: wall time of extrapolating the colour of unshaded frames.
        stages: wall time by stage of the CPU backend, seconds; empty with other backends.
        converged: fraction of the image, in [0, 1], that is frozen after the last frame. From 0.99 on
            a viewer may stop rendering until something moves or changes. None if the method does not
            converge.
    """

    frames: int = 0
    extrapolated: int = 0
    resets: int = 0
    seconds: float = 0.0
    extrapolation_seconds: float = 0.0
    stages: Mapping[str, float] = field(default_factory=dict)
    converged: float | None = 0.0


@dataclass(frozen=True)
class State:
    """A copy of an Upscaler's history as plain arrays and numbers, which can be pickled.

    Attributes:
        method: name of the method.
        display_size: (width, height) of the images.
        render_size: (width, height) of the previous frame; None without a history.
        history: tensors by name; None without a history.
        shaded: tensors from which unshaded frames are extrapolated; None before a shaded frame.
        version: STATE_VERSION of the package that saved it.
    """

    method: str
    display_size: Size | None
    render_size: Size | None
    history: Mapping[str, NDArray[Any]] | None
    shaded: Mapping[str, NDArray[Any]] | None = None
    version: int = field(default_factory=lambda: STATE_VERSION)  # old pickles lack it; no class attribute
