"""`Model`: one exported method in one ONNX Runtime session. Pure: it remembers nothing between calls."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnxruntime as ort

from supersampler.carry import Carrier, check_carry
from supersampler.errors import ArgumentError, FrameError
from supersampler.frame import Float32, Frame, Size
from supersampler.graph_session import frame_inputs, open_session, pixels_of
from supersampler.model_info import ModelInfo, TensorInfo, find_model, read_model_info
from supersampler.providers import check_provider_in_use, resolve_providers

_CARRY = "history.carry"
_DEVICES = {
    "CUDAExecutionProvider": "cuda",
    "TensorrtExecutionProvider": "cuda",
    "DmlExecutionProvider": "dml",
}


@dataclass(eq=False)
class History:
    """What one frame leaves for the next: tensors on the device of the model, all zeros for no past.

    Attributes:
        display_size: (width, height) of the images that it belongs to.
        render_size: (width, height) of the frame that left it.
        tensors: by graph input name.
        carry: (1, k, H, W) what the frame carried along; None where it was not asked for.
    """

    display_size: Size
    render_size: Size
    tensors: dict[str, ort.OrtValue]
    carry: Float32 | None = None

    def to_numpy(self) -> dict[str, Float32]:
        """Copies of all tensors on the host."""
        copies = {name: np.array(tensor.numpy()) for name, tensor in self.tensors.items()}
        return copies if self.carry is None else {**copies, _CARRY: self.carry.copy()}


@dataclass(frozen=True, eq=False)
class Result:
    """An image, and what else was asked for; what was not is None.

    Attributes:
        image: (H, W, 3) float32 linear RGB.
        carry: (H, W, k) float32 what the frame carries along, blended as the image is.
        class_map: (H / 2, W / 2, 6) float32, sizes rounded up: shares of each 2x2 pixels' classes. None of a
            past, hidden before, changed light; then no aliasing, of an edge, of fine detail.
        weight: (H, W) float32 share of the past in the image, [0, 1].
        count: (H, W) float32 how many samples the image is worth.
    """

    image: Float32
    carry: Float32 | None = None
    class_map: Float32 | None = None
    weight: Float32 | None = None
    count: Float32 | None = None


class Model:
    """An exported method, ready to run; shareable between threads and Upscalers.

    Attributes:
        info: what its model.json says.
        providers: execution providers of ONNX Runtime in use, in order.
    """

    def __init__(self, info: ModelInfo, session: ort.InferenceSession, carrier: Carrier) -> None:
        self.info = info
        self._carrier = carrier
        self.providers: list[str] = session.get_providers()
        self._session = session
        self._device = _DEVICES.get(self.providers[0], "cpu")

    @classmethod
    def load(
        cls, name_or_path: str | Path, *, providers: str | Sequence[str] = "auto", threads: int = 0
    ) -> "Model":
        """Load a shipped model by name, or a model folder by path.

        Args:
            name_or_path: one of `supersampler.model_names()`, or a folder with a model.json.
            providers: "auto" (CUDA, DirectML, else CPU), a provider's name ("cpu", "cuda", "directml", ... or
                ONNX Runtime's own), or several in order of preference.
            threads: threads of the CPU provider; 0 takes every core.

        Raises:
            ModelError: no such model, a damaged folder, or another contract.
            ProviderError: a provider was asked for and cannot be had.
        """
        info = read_model_info(find_model(name_or_path))
        names = resolve_providers(providers)
        options = ort.SessionOptions()
        options.log_severity_level = 3  # errors only; the rest would print over a progress bar
        options.intra_op_num_threads = threads
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        session = open_session(info.step_path, options, names)
        check_provider_in_use(names[0], session.get_providers())
        return cls(info, session, Carrier(info, options))

    def first_history(self, display_size: Size, render_size: Size) -> History:
        """No past: all zeros."""
        tensors = {
            h.input.name: self._zeros(h.input, render_size, display_size, render_size)
            for h in self.info.history
        }
        return History(display_size, render_size, tensors)

    def run(
        self,
        frame: Frame,
        history: History,
        *,
        out: Float32 | None = None,
        history_out: History | None = None,
    ) -> tuple[Float32, History]:
        """Upscale one frame to the display size of `history`.

        Args:
            frame: its `reset` is not looked at; hand in `first_history` for a frame without a past.
            history: what the frame before left; not changed.
            out: (H, W, 3) float32 to write the image to; a new array where None.
            history_out: buffers of an older history to write to; new ones where None.

        Returns:
            The image (H, W, 3) float32, linear RGB, >= 0, and the history for the next frame.

        Raises:
            FrameError: the frame lacks an input, or its size does not fit.
            ArgumentError: `out` has the wrong shape or type, or `history_out` is `history`.
        """
        result, left = self.run_wanted(frame, history, (), out=out, history_out=history_out)
        return result.image, left

    def run_wanted(
        self,
        frame: Frame,
        history: History,
        want: Collection[str],
        *,
        out: Float32 | None = None,
        history_out: History | None = None,
    ) -> tuple[Result, History]:
        """Upscale as `run` does, and return what `want` names of `Result` with the image.

        What is not named costs nothing.

        Raises:
            FrameError: as `run`; or the frame carries nothing, or other channels than the one before, and
                "carry" is wanted.
            ArgumentError: as `run`; or the model does not know what `want` names.
        """
        self.check(frame, history.display_size, want, history.carry)
        if history_out is history:
            raise ArgumentError("history_out", got="history itself", want="other buffers")
        width, height = display_size = history.display_size
        image = _checked_out(out, (height, width, 3))
        planes = np.empty((1, 3, height, width), np.float32)
        history_out = self._prepared(history_out, display_size, frame.size)
        told = self._told(want, display_size)

        binding = self._session.io_binding()
        names = [t.name for t in self.info.inputs]
        for name, array in frame_inputs(frame, display_size, names).items():
            binding.bind_cpu_input(name, array)
        for h in self.info.history:
            binding.bind_ortvalue_input(h.input.name, history.tensors[h.input.name])
            binding.bind_ortvalue_output(h.output, history_out.tensors[h.input.name])
        for name, array in ((self.info.image.name, planes), *told.items()):
            binding.bind_ortvalue_output(name, ort.OrtValue.ortvalue_from_numpy(array))
        self._session.run_with_iobinding(binding)

        np.copyto(image, planes[0].transpose(1, 2, 0))
        if "carry" in want:
            past = history.carry
            history_out.carry = self._carrier.blend(frame, told.get("weight"), past, display_size)
        return self._result(image, want, told, history_out), history_out

    def load_history(self, display_size: Size, render_size: Size, arrays: Mapping[str, Float32]) -> History:
        """Put copies made by `History.to_numpy` back on the device."""
        history = self.first_history(display_size, render_size)
        for name, tensor in history.tensors.items():
            if name not in arrays or list(arrays[name].shape) != list(tensor.shape()):
                raise ArgumentError(
                    "state", got=f"without a fitting {name!r}", want=f"one saved by {self.info.method!r}"
                )
            tensor.update_inplace(np.ascontiguousarray(arrays[name], np.float32))
        if _CARRY in arrays:
            carry = arrays[_CARRY]
            if carry.ndim != 4 or carry.shape[2:] != display_size[::-1]:
                want = f"(1, k, {display_size[1]}, {display_size[0]})"
                raise ArgumentError("state", got=f"with {_CARRY!r} {carry.shape}", want=want)
            history.carry = carry.copy()
        return history

    def check(
        self,
        frame: Frame,
        display_size: Size,
        want: Collection[str] = (),
        carried: Float32 | None = None,
    ) -> None:
        """Raise what `run_wanted` would for this frame, before anything is done with it.

        Args:
            frame: the frame.
            display_size: (width, height) of the image.
            want: what else than the image.
            carried: what the frame before carried, `History.carry`.

        Raises:
            FrameError, ArgumentError: see `run_wanted`.
        """
        if frame.color is None:
            raise FrameError("color", got=None, want=f"(h, w, 3); {self.info.method!r} needs shaded frames")
        self._check_ratio(frame, display_size)
        known = ["carry", *self.info.maps]
        if isinstance(want, str) or not set(want) <= set(known):
            raise ArgumentError("want", got=repr(want), want=f"any of {', '.join(known)}, in a tuple")
        if "carry" in want:
            check_carry(frame, carried)

    def _check_ratio(self, frame: Frame, display_size: Size) -> None:
        low, high = self.info.ratios
        for axis, name in enumerate(("width", "height")):
            ratio = display_size[axis] / frame.size[axis]
            slack = 1.0 / frame.size[axis]  # display sizes are rounded to whole pixels
            if not low - slack <= ratio <= high + slack:
                raise FrameError(
                    "size",
                    got=f"{frame.size}, {ratio:.3g} times less in {name} than the display's {display_size}",
                    want=f"a ratio from {low} to {high}",
                    hint="Sizes are (width, height).",
                )

    def _told(self, want: Collection[str], display: Size) -> dict[str, Float32]:
        """Buffers for what the graph tells beside image and history, as far as it is wanted."""
        needed = {self.info.maps[name].output for name in want if name != "carry"}
        needed |= {"weight"} if "carry" in want else set()
        return {
            t.name: np.empty(t.shape_for(render=display, display=display, previous=display), np.float32)
            for t in self.info.told
            if t.name in needed
        }

    def _result(
        self, image: Float32, want: Collection[str], told: Mapping[str, Float32], left: History
    ) -> Result:
        inputs = {h.output: h.input.name for h in self.info.history}
        maps: dict[str, Float32] = {}
        for name in set(want) - {"carry"}:
            where = self.info.maps[name]
            tensor = told.get(where.output)
            planes = left.tensors[inputs[where.output]].numpy() if tensor is None else tensor
            maps[name] = pixels_of(planes[:, where.first : where.first + where.channels])
        carry = None if left.carry is None else left.carry[0].transpose(1, 2, 0).copy()
        return Result(image, carry=carry, **maps)

    def _prepared(self, history: History | None, display: Size, render: Size) -> History:
        """Buffers that this frame's history fits in, those of `history` where they do."""
        tensors = {}
        for h in self.info.history:
            old = None if history is None else history.tensors[h.input.name]
            shape = h.input.shape_for(render=render, display=display, previous=render)
            fits = old is not None and list(old.shape()) == list(shape)
            tensors[h.input.name] = old if fits else self._zeros(h.input, render, display, render)
        return History(display, render, tensors)

    def _zeros(self, tensor: TensorInfo, render: Size, display: Size, previous: Size) -> ort.OrtValue:
        shape = tensor.shape_for(render=render, display=display, previous=previous)
        return ort.OrtValue.ortvalue_from_numpy(np.zeros(shape, np.float32), self._device, 0)


def _checked_out(out: Float32 | None, shape: tuple[int, ...]) -> Float32:
    if out is None:
        return np.empty(shape, np.float32)
    if not isinstance(out, np.ndarray) or out.shape != shape or out.dtype != np.float32:
        got = f"{out.shape} {out.dtype}" if isinstance(out, np.ndarray) else type(out).__name__
        raise ArgumentError("out", got=got, want=f"{shape} float32 numpy array")
    if not out.flags.writeable:
        raise ArgumentError("out", got="read-only", want="a writable array")
    return out
