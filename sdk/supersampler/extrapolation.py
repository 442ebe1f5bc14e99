"""Extrapolation of the colour of unshaded frames from the last shaded frame (docs/contract.md)."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import ExecutorName, checked_path
from supersampler.backends.onnx.session import frame_inputs
from supersampler.errors import ArgumentError, FrameError, ModelError
from supersampler.frame import Float32, Frame
from supersampler.methods.array_spec import ArraySpec, checked_arrays, values_of
from supersampler.methods.executors import choose_extrapolation
from supersampler.methods.gbuffers import check_gbuffers
from supersampler.methods.model_file import extrapolation_names, find_model, read_model_info

if TYPE_CHECKING:
    import wgpu

    from supersampler.model import Model

MOTION, SHADED_MOTION = "motion", "shaded_motion"
"""History tensors: motion from the previous frame back to the last shaded one; that frame's own motion."""
EARLIER = "earlier_"
"""Prefix of tensors that hold the history as it was before the last shaded frame."""
_FRAME_INPUTS = {name: name for name in ("color", "depth", "jitter", "motion")}
_FRAME_INPUTS |= {"motion_jitter": "jitter", SHADED_MOTION: "motion"}
"""Frame input that fills a history tensor; the other history tensors are named after G-buffers."""

ShadedHistory: TypeAlias = Mapping[str, Any]
"""History from which unshaded frames are extrapolated: the last shaded frame, and the motion since then.

Tensors of the executor by their names in the graph, read only."""


class Extrapolator:
    """A model that computes the colour of unshaded frames. It keeps no state between calls.

    Attributes:
        info: content of its model.json.
        executor: the backend in use, "onnx", "cpu" or "gpu".

    Raises:
        ModelError: the model does not exist, is damaged, or does not extrapolate.
        ProviderError: a provider cannot start.
        DeviceError: there is no GPU, or it does not compile the shaders, and `executor` is "gpu".
    """

    def __init__(
        self,
        name_or_path: str | Path,
        providers: Sequence[str],
        threads: int,
        executor: ExecutorName = "auto",
        device: "wgpu.GPUDevice | None" = None,
    ) -> None:
        self.info = read_model_info(find_model(checked_path("extrapolation", name_or_path)))
        if not self.info.extrapolates:
            raise ModelError(
                f"{self.info.method!r} upscales and does not extrapolate; "
                f"extrapolation takes {' or '.join(extrapolation_names())}, or a folder of such a model."
            )
        self._executor = choose_extrapolation(self.info, providers, threads, executor, device)
        self.executor = self._executor.name

    def after_shaded(self, frame: Frame, history: ShadedHistory | None = None) -> ShadedHistory:
        """Return the history after a shaded frame: copies of the frame's arrays, and no motion.

        The colour is stored without pre-exposure.

        Args:
            frame: the frame.
            history: history before this frame, parts of which a model may keep; ignored on a reset.

        Raises:
            FrameError: the frame lacks a G-buffer that the model reads.
        """
        check_gbuffers(frame, self.info.gbuffers, frame.size, self.info.method)
        history = None if frame.reset else history
        tensors: dict[str, Any] = {}
        for full_name in (entry.name for entry in self.info.history):
            name = full_name.removeprefix("history.")
            if name.startswith(EARLIER):
                source = tensors if history is None else history
                tensors[full_name] = source[f"history.{name.removeprefix(EARLIER)}"]
            elif name == MOTION or (name == SHADED_MOTION and history is None):
                zeros = np.zeros((1, 2, *frame.size[::-1]), np.float32)
                tensors[full_name] = self._executor.upload(zeros)
            else:
                input_name = _FRAME_INPUTS.get(name, f"gbuffer_{name}")
                array = frame_inputs(frame, frame.size, (input_name,))[input_name]
                if name == "color" and frame.pre_exposure != 1.0:
                    array = array / np.float32(frame.pre_exposure)
                # engines reuse their buffers, so a view of the frame is copied
                tensors[full_name] = self._executor.upload(array if array.base is None else array.copy())
        return tensors

    def extrapolate(self, frame: Frame, history: ShadedHistory | None) -> tuple[Float32, ShadedHistory]:
        """Compute the colour of an unshaded frame.

        Args:
            frame: a frame without colour, and without a reset.
            history: history after the previous frame; not changed. None before the first shaded frame.

        Returns:
            The colour, (h, w, 3) float32 linear RGB, finite and >= 0; and the next history.

        Raises:
            FrameError: the frame has colour or lacks a G-buffer that the model reads, or there is no history.
        """
        if frame.color is not None:
            want, hint = "None, because it is extrapolated", "`step` takes shaded frames."
            raise FrameError("color", got=frame.color.shape, want=want, hint=hint)
        if frame.reset:
            hint = "Shade the first frame after a cut: there is nothing to extrapolate from."
            raise FrameError("reset", got="True on a frame that was not shaded", want="False", hint=hint)
        if history is None:
            hint = "`step` a shaded frame first: after a start or reset there is nothing to extrapolate from."
            raise FrameError("color", got="None before any shaded frame", want="(h, w, 3)", hint=hint)
        check_gbuffers(frame, self.info.gbuffers, frame.size, self.info.method)
        return self._executor.extrapolate(frame, history)

    def save(self, history: ShadedHistory) -> dict[str, NDArray[Any]]:
        """Return copies of a history's tensors, by name in the graph."""
        return {name: self._executor.download(tensor) for name, tensor in history.items()}

    def load(self, arrays: Mapping[str, NDArray[Any]]) -> ShadedHistory:
        """Return the history that `save` copied.

        Images may hold any values, as in a frame: they are sanitized when they are read.

        Raises:
            ArgumentError: the arrays belong to another model, or their types or sizes do not match.
        """
        specs = {
            h.name: ArraySpec(h.type, h.shape, values_of(h.name) if "jitter" in h.name else None)
            for h in self.info.history
        }
        checked = checked_arrays(
            arrays, specs, lambda got, want: ArgumentError("state.shaded", got=got, want=want)
        )
        return {name: self._executor.upload(np.array(a, order="C")) for name, a in checked.items()}


def extrapolator_beside(
    model: "Model", name_or_path: str | Path, executor: ExecutorName = "auto"
) -> Extrapolator:
    """Return an Extrapolator with the providers, the threads and, on the GPU, the device of a Model.

    Raises:
        ModelError, ProviderError, DeviceError: see `Extrapolator`.
    """
    if model.executor != "gpu":
        return Extrapolator(name_or_path, model.providers, model.threads, executor)
    return Extrapolator(name_or_path, model.providers, model.threads, "gpu", model.gpu.device)
