"""The colour of frames that were not shaded, drawn from the last one that was (docs/contract.md)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import checked_path
from supersampler.backends.onnx.extrapolation import ExtrapolationExecutor, OnnxExtrapolation
from supersampler.backends.onnx.providers import CPU
from supersampler.backends.onnx.session import frame_inputs
from supersampler.errors import ArgumentError, FrameError, ModelError
from supersampler.frame import Float32, Frame
from supersampler.methods.array_spec import checked_arrays
from supersampler.methods.cpu_backends import cpu_extrapolation
from supersampler.methods.gbuffers import check_gbuffers
from supersampler.methods.model_file import extrapolation_names, find_model, read_model_info
from supersampler.model import ExecutorName

MOTION, SHADED_MOTION = "motion", "shaded_motion"
"""Of the history: from the frame last handed in back to the last shaded one, and that one's own motion."""
EARLIER = "earlier_"
"""Begins the names of what is kept of the past that a shaded frame ends."""
_SAME_NAME = ("color", "depth", "jitter", "motion")  # of inputs; those of G-buffers begin with their group
_OTHER_NAME = {"motion_jitter": "jitter", SHADED_MOTION: "motion"}


@dataclass(frozen=True, eq=False)
class ShadedHistory:
    """What frames that are not shaded are drawn from: the last shaded one, and how things have moved since.

    Attributes:
        tensors: by their names in the graph, as `ExtrapolationExecutor.placed` made them; read only.
    """

    tensors: Mapping[str, Any]


class Extrapolator:
    """A model that draws frames that were not shaded, ready to run. Pure: it remembers nothing between calls.

    Args:
        name_or_path: of a shipped model, or a model folder.
        providers: names of execution providers of ONNX Runtime, in order.
        threads: on the CPU; 0 takes every core.
        executor: "graph" runs it in ONNX Runtime even where kernels of this processor could.

    Attributes:
        info: what its model.json says.
        executor: what it runs on, "onnx" or "cpu".

    Raises:
        ModelError: there is no such model, it is damaged, or it is one that upscales.
        ProviderError: a provider could not start.
    """

    def __init__(
        self,
        name_or_path: str | Path,
        providers: Sequence[str],
        threads: int,
        executor: ExecutorName = "auto",
    ) -> None:
        self.info = read_model_info(find_model(checked_path("extrapolation", name_or_path)))
        if not self.info.extrapolates:
            raise ModelError(
                f"{self.info.method!r} upscales, and draws no frames that were not shaded; "
                f"extrapolation takes {' or '.join(extrapolation_names())}, or a model folder like those."
            )
        on_host = executor != "onnx" and list(providers) == [CPU]
        kernels = cpu_extrapolation(self.info, threads, required=executor == "cpu") if on_host else None
        self._drawing: ExtrapolationExecutor = kernels or OnnxExtrapolation(self.info, providers, threads)
        self.executor = self._drawing.name

    def after_shaded(self, frame: Frame, past: ShadedHistory | None = None) -> ShadedHistory:
        """Return what a shaded frame leaves: copies of its own arrays, and no motion.

        Args:
            frame: with colour.
            past: what the frame before left, which models may keep parts of; not changed. None where there
                was none, and not looked at after a cut.

        Raises:
            FrameError: it lacks a G-buffer that the model reads.
        """
        check_gbuffers(frame, self.info.gbuffers, frame.size, self.info.method)
        past, placed = None if frame.reset else past, self._drawing.placed
        tensors: dict[str, Any] = {}
        for history in self.info.history:
            own = _bare(history.input.name).removeprefix(EARLIER)
            if own != _bare(history.input.name):
                before = tensors if past is None else past.tensors
                tensors[history.input.name] = before[_of_history(own)]
            elif own == MOTION or (own == SHADED_MOTION and past is None):
                tensors[history.input.name] = placed(np.zeros((1, 2, *frame.size[::-1]), np.float32))
            else:
                tensors[history.input.name] = placed(_copied(frame, _OTHER_NAME.get(own, own)))
        return ShadedHistory(tensors)

    def draw(self, frame: Frame, past: ShadedHistory | None) -> tuple[Float32, ShadedHistory]:
        """Draw the colour of a frame that was not shaded.

        Args:
            frame: without colour, and not the first after a cut.
            past: what the frame before left; not changed. None where no frame was shaded yet.

        Returns:
            (h, w, 3) float32 linear RGB, finite and >= 0, and what this frame leaves.

        Raises:
            FrameError: the frame has colour, has no past, or lacks a G-buffer that the model reads.
        """
        past = _checked(frame, past)
        check_gbuffers(frame, self.info.gbuffers, frame.size, self.info.method)
        color, left = self._drawing.draw(frame, past.tensors)
        return color, ShadedHistory(left)

    def save(self, past: ShadedHistory) -> dict[str, NDArray[Any]]:
        """Copies of what a frame left, by the names of the contract."""
        return {name: self._drawing.copied(value) for name, value in past.tensors.items()}

    def load(self, arrays: Mapping[str, NDArray[Any]]) -> ShadedHistory:
        """Undo `save`.

        Images are those of frames, which may hold anything, and are read as a frame's own; what they have
        that is not finite is as harmless as there.

        Raises:
            ArgumentError: they are of another model, of other types, or of sizes that do not go together.
        """
        specs = {h.input.name: h.input.spec_of_frames() for h in self.info.history}
        checked = checked_arrays(
            arrays, specs, lambda got, want: ArgumentError("state.shaded", got=got, want=want)
        )
        return ShadedHistory(
            {name: self._drawing.placed(np.array(a, order="C")) for name, a in checked.items()}
        )


class Extrapolation:
    """What one view needs for frames that are not shaded: an `Extrapolator`, if any. Remembers nothing.

    Args:
        name_or_path: see `Extrapolator`; None keeps nothing, and draws nothing.
        providers: see `Extrapolator`.
        threads: see `Extrapolator`.
        executor: see `Extrapolator`.

    Attributes:
        infos: of the model; empty where there is none.

    Raises:
        ModelError, ProviderError: see `Extrapolator`.
    """

    def __init__(
        self,
        name_or_path: str | Path | None,
        providers: Sequence[str],
        threads: int,
        executor: ExecutorName,
    ) -> None:
        self._model = (
            None if name_or_path is None else Extrapolator(name_or_path, providers, threads, executor)
        )
        self.infos = [] if self._model is None else [self._model.info]

    def after_shaded(self, frame: Frame, past: ShadedHistory | None) -> ShadedHistory | None:
        """Return what a shaded frame leaves; see `Extrapolator`."""
        return None if self._model is None else self._model.after_shaded(frame, past)

    def draw(self, frame: Frame, past: ShadedHistory | None) -> tuple[Frame, ShadedHistory]:
        """Return a frame with its colour drawn, and what it leaves; see `Extrapolator`.

        Raises:
            ArgumentError: there is no model.
            FrameError: see `Extrapolator`.
        """
        if self._model is None:
            hint = "Upscaler(extrapolation='guided-warp') draws frames that were not shaded."
            raise ArgumentError("extrapolation", got=None, want="a model", hint=hint)
        color, left = self._model.draw(frame, past)
        return replace(frame, color=color), left

    def warm_up(self, frame: Frame) -> None:
        """Run once, on a shaded frame."""
        if self._model is not None:
            self._model.draw(replace(frame, color=None), self._model.after_shaded(frame))

    def save(self, past: ShadedHistory | None) -> dict[str, NDArray[Any]] | None:
        """Copies of the past; None where there is none."""
        return None if self._model is None or past is None else self._model.save(past)

    def load(self, arrays: Mapping[str, NDArray[Any]] | None) -> ShadedHistory | None:
        """Return what `save` copied as a past, which is None without a model.

        Raises:
            ArgumentError: see `Extrapolator`.
        """
        return None if self._model is None or arrays is None else self._model.load(arrays)


def _bare(name: str) -> str:
    return name.removeprefix("history.")


def _of_history(name: str) -> str:
    return f"history.{name}"


def _copied(frame: Frame, name: str) -> NDArray[Any]:
    """What a graph takes of a frame, in memory that nobody else has: engines use their buffers again."""
    source = name if name in _SAME_NAME else f"gbuffer_{name}"
    array = frame_inputs(frame, frame.size, (source,))[source]
    return array if array.base is None else array.copy()


def _checked(frame: Frame, past: ShadedHistory | None) -> ShadedHistory:
    if frame.color is not None:
        hint = "`step` takes shaded frames."
        raise FrameError("color", got=frame.color.shape, want="None, as it is to be drawn", hint=hint)
    if frame.reset:
        hint = "There is nothing to draw it from: shade the first frame after a cut."
        raise FrameError("reset", got="True on a frame that was not shaded", want="False", hint=hint)
    if past is None:
        hint = "After a start or a reset there is nothing to draw from: shade a frame, and `step` it."
        raise FrameError("color", got="None before any shaded frame", want="(h, w, 3)", hint=hint)
    return past
