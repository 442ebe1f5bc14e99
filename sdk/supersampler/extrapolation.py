"""Extrapolation: the colour of unshaded frames, computed from the last shaded one (docs/contract.md)."""

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
"""Prefix of tensors that hold the history as it was before the last shaded frame."""
_SAME_NAME = ("color", "depth", "jitter", "motion")  # of inputs; those of G-buffers begin with their group
_OTHER_NAME = {"motion_jitter": "jitter", SHADED_MOTION: "motion"}


@dataclass(frozen=True, eq=False)
class ShadedHistory:
    """What unshaded frames are extrapolated from: the last shaded frame, and the motion since.

    Attributes:
        tensors: by their names in the graph, where `ExtrapolationExecutor.placed` put them; read only.
    """

    tensors: Mapping[str, Any]


class Extrapolator:
    """A model that computes the colour of unshaded frames. Pure: it remembers nothing between calls.

    Args:
        name_or_path: of a shipped model, or a model folder.
        providers: names of execution providers of ONNX Runtime, in order.
        threads: on the CPU; 0 takes every core.
        executor: "onnx" runs it in ONNX Runtime even where it has kernels for this processor.

    Attributes:
        info: what its model.json says.
        executor: the backend in use, "onnx" or "cpu".

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
                f"{self.info.method!r} upscales, and extrapolates no unshaded frames; "
                f"extrapolation takes {' or '.join(extrapolation_names())}, or a model folder like those."
            )
        on_cpu = executor != "onnx" and list(providers) == [CPU]
        kernels = cpu_extrapolation(self.info, threads, required=executor == "cpu") if on_cpu else None
        self._executor: ExtrapolationExecutor = kernels or OnnxExtrapolation(self.info, providers, threads)
        self.executor = self._executor.name

    def after_shaded(self, frame: Frame, history: ShadedHistory | None = None) -> ShadedHistory:
        """Return the history after a shaded frame: copies of its own arrays, and no motion.

        Args:
            frame: with colour.
            history: after the previous frame; models may keep parts of it; not changed. None where there is
                none; not read after a cut.

        Raises:
            FrameError: it lacks a G-buffer that the model reads.
        """
        check_gbuffers(frame, self.info.gbuffers, frame.size, self.info.method)
        history, placed = None if frame.reset else history, self._executor.placed
        tensors: dict[str, Any] = {}
        for item in self.info.history:
            own = _bare(item.input.name).removeprefix(EARLIER)
            if own != _bare(item.input.name):
                before = tensors if history is None else history.tensors
                tensors[item.input.name] = before[_of_history(own)]
            elif own == MOTION or (own == SHADED_MOTION and history is None):
                tensors[item.input.name] = placed(np.zeros((1, 2, *frame.size[::-1]), np.float32))
            else:
                tensors[item.input.name] = placed(_copied(frame, _OTHER_NAME.get(own, own)))
        return ShadedHistory(tensors)

    def extrapolate(self, frame: Frame, history: ShadedHistory | None) -> tuple[Float32, ShadedHistory]:
        """Compute the colour of an unshaded frame.

        Args:
            frame: without colour, and not the first after a cut.
            history: after the previous frame; not changed. None where no frame was shaded yet.

        Returns:
            (h, w, 3) float32 linear RGB, finite and >= 0, and the next history.

        Raises:
            FrameError: the frame has colour or lacks a G-buffer that the model reads, or there is no history.
        """
        history = _checked(frame, history)
        check_gbuffers(frame, self.info.gbuffers, frame.size, self.info.method)
        color, next_tensors = self._executor.draw(frame, history.tensors)
        return color, ShadedHistory(next_tensors)

    def save(self, history: ShadedHistory) -> dict[str, NDArray[Any]]:
        """Copies of a history's tensors, by the names of the contract."""
        return {name: self._executor.copied(value) for name, value in history.tensors.items()}

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
            {name: self._executor.placed(np.array(a, order="C")) for name, a in checked.items()}
        )


class Extrapolation:
    """What one view needs for unshaded frames: an `Extrapolator`, if any. Remembers nothing.

    Args:
        name_or_path: see `Extrapolator`; None keeps nothing, and extrapolates nothing.
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

    def after_shaded(self, frame: Frame, history: ShadedHistory | None) -> ShadedHistory | None:
        """Return the history after a shaded frame; see `Extrapolator`."""
        return None if self._model is None else self._model.after_shaded(frame, history)

    def extrapolate(self, frame: Frame, history: ShadedHistory | None) -> tuple[Frame, ShadedHistory]:
        """Return a frame with its colour computed, and the next history; see `Extrapolator`.

        Raises:
            ArgumentError: there is no model.
            FrameError: see `Extrapolator`.
        """
        if self._model is None:
            hint = "Upscaler(extrapolation='guided-warp') takes frames that were not shaded."
            raise ArgumentError("extrapolation", got=None, want="a model", hint=hint)
        color, next_history = self._model.extrapolate(frame, history)
        return replace(frame, color=color), next_history

    def warm_up(self, frame: Frame) -> None:
        """Run once, on a shaded frame."""
        if self._model is not None:
            self._model.extrapolate(replace(frame, color=None), self._model.after_shaded(frame))

    def save(self, history: ShadedHistory | None) -> dict[str, NDArray[Any]] | None:
        """Copies of the history; None where there is none."""
        return None if self._model is None or history is None else self._model.save(history)

    def load(self, arrays: Mapping[str, NDArray[Any]] | None) -> ShadedHistory | None:
        """Return what `save` copied as a history; None without a model.

        Raises:
            ArgumentError: see `Extrapolator`.
        """
        return None if self._model is None or arrays is None else self._model.load(arrays)


def _bare(name: str) -> str:
    return name.removeprefix("history.")


def _of_history(name: str) -> str:
    return f"history.{name}"


def _copied(frame: Frame, name: str) -> NDArray[Any]:
    """Return a graph's input of a frame, in memory of its own: engines reuse their buffers."""
    source = name if name in _SAME_NAME else f"gbuffer_{name}"
    array = frame_inputs(frame, frame.size, (source,))[source]
    return array if array.base is None else array.copy()


def _checked(frame: Frame, history: ShadedHistory | None) -> ShadedHistory:
    if frame.color is not None:
        hint = "`step` takes shaded frames."
        raise FrameError("color", got=frame.color.shape, want="None, as it is to be extrapolated", hint=hint)
    if frame.reset:
        hint = "There is nothing to extrapolate from: shade the first frame after a cut."
        raise FrameError("reset", got="True on a frame that was not shaded", want="False", hint=hint)
    if history is None:
        hint = "After a start or a reset there is nothing to extrapolate from: shade a frame, and `step` it."
        raise FrameError("color", got="None before any shaded frame", want="(h, w, 3)", hint=hint)
    return history
