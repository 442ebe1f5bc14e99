"""`CpuExecutor` and `CpuExtrapolation`: run steps and `guided-warp` in the CPU library."""

import math
from collections.abc import Mapping, Sequence
from ctypes import c_double, c_int, c_int64, c_size_t, c_void_p
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.base import AovRequest, StepReport, StepRequest
from supersampler.backends.cpu import library as native
from supersampler.frame import Float32, Frame, Size
from supersampler.io.display import usable_exposure
from supersampler.methods.gbuffers import GBUFFERS

_STAGES = 5
_AUX_OUTPUTS = ("weight", "converged")


class CpuModel:
    """A model in the library. It is freed with this object.

    Args:
        library: the library.
        data: the bytes of the model; see `model_bytes`.
        options: threads, instruction set, ...; see `ss_options`.

    Raises:
        ModelError: the bytes are not a model that the library runs.
    """

    def __init__(self, library: native.CpuLibrary, data: bytes, options: native.Options) -> None:
        self.library, self.handle = library, c_void_p()
        library.call("ss_model_create_from_bytes", data, len(data), options, self.handle)

    def __del__(self) -> None:
        self.library.ss_model_destroy(self.handle)

    @property
    def instructions(self) -> str:
        """Name of the instruction set in use."""
        return str(self.library.ss_model_instructions(self.handle).decode())


class CpuHistory:
    """A history in the library. It is freed with this object."""

    def __init__(self, model: CpuModel, display: Size, render: Size) -> None:
        self.model, self.display, self.handle = model, display, c_void_p()
        model.library.call("ss_history_create", model.handle, *display, *render, self.handle)

    def __del__(self) -> None:
        self.model.library.ss_history_destroy(self.handle)

    def tensors(self) -> dict[str, tuple[int, ...]]:
        """Return the shape of each tensor by its name in the graph, in the library's order."""
        found: dict[str, tuple[int, ...]] = {}
        shape, axes = (c_int64 * 4)(), c_int()
        while name := self.model.library.ss_history_tensor(self.handle, len(found), shape, axes):
            found[f"history.{name.decode()}"] = tuple(shape)[: axes.value]
        return found


class CpuExecutor:
    """Runs steps of one model in the library; see `Executor`."""

    name = "cpu"

    def __init__(self, model: CpuModel, precision: str) -> None:
        self._model, self._library, self.precision = model, model.library, precision
        self._names = [self._library.ss_stage_name(stage).decode() for stage in range(_STAGES)]

    @property
    def handle(self) -> c_void_p:
        """The model in the library."""
        return self._model.handle

    def zeros(self, display: Size, render: Size) -> CpuHistory:
        """See `Executor`."""
        return CpuHistory(self._model, display, render)

    def fits(self, buffers: CpuHistory, display: Size, render: Size) -> bool:
        """See `Executor`."""
        return buffers.display == display and bool(self._library.ss_history_fits(buffers.handle, *render))

    def step_many(self, steps: Sequence[StepRequest]) -> list[StepReport]:
        """See `Executor`."""
        count = len(steps)
        frames, outputs, alive = (native.FrameData * count)(), (native.Outputs * count)(), []
        histories, next_histories = (c_void_p * count)(), (c_void_p * count)()
        aux, seconds = [], [(c_double * _STAGES)() for _ in steps]
        for place, step in enumerate(steps):
            frames[place], arrays = frame_data(step.frame)
            frames[place].adds_samples = step.adds_samples
            alive.append(arrays)
            histories[place], next_histories[place] = step.history.handle, step.next_history.handle
            shape = (1, 1, *step.display[::-1])
            planes = {n: np.zeros(shape, np.float32) for n in _AUX_OUTPUTS if n in step.aux_outputs}
            aux.append(planes)
            images = {n: native.Image.of(plane[0, 0]) for n, plane in planes.items()}
            outputs[place] = native.Outputs(
                image=native.Image.of(step.image), compute_all=not step.skip, seconds=seconds[place], **images
            )
        with self._library.interruptible(outputs[0]):
            self._library.call(
                "ss_run_many", self._model.handle, frames, histories, next_histories, outputs, count
            )
        del alive  # what the library read
        return [
            StepReport(planes, {name: time for name, time in zip(self._names, times, strict=True) if time})
            for planes, times in zip(aux, seconds, strict=True)
        ]

    def blend_aovs(self, requests: Sequence[AovRequest]) -> list[Float32]:
        """Upsample the AOVs of several views to display size, and blend them with their history.

        Returns:
            (1, k, H, W) of each view, whose channels of a pixel lie next to each other in memory.
        """
        views, alive, results = (native.AovData * len(requests))(), [], []
        for place, (frame, display, weight, history) in enumerate(requests):
            given = np.ascontiguousarray(frame.aovs, np.float32)
            image = np.empty((*display[::-1], given.shape[2]), np.float32)
            arrays: dict[str, NDArray[Any]] = {
                "aovs": given,
                "depth": np.ascontiguousarray(frame.depth),
                "motion": np.ascontiguousarray(frame.motion, np.float32),
                "image": image,
            }
            if weight is not None:
                arrays["weight"] = weight
            if history is not None:
                arrays["previous"] = np.ascontiguousarray(history[0].transpose(1, 2, 0))
            views[place] = native.view_of(native.AovData, frame, display, given.shape[2], arrays)
            alive.append(arrays)
            results.append(image.transpose(2, 0, 1)[None])
        self._library.call("ss_blend_aovs", self._model.handle, views, len(requests))
        del alive  # what the library read
        return results

    def required_bytes(self, display: Size, render: Size) -> tuple[int, int | None]:
        """See `Executor`."""
        history, working = c_size_t(), c_size_t()
        self._library.call("ss_required_bytes", self._model.handle, *display, *render, history, working)
        return history.value, working.value

    def tensor(self, buffers: CpuHistory, name: str) -> Float32:
        """See `Executor`."""
        shapes = buffers.tensors()
        values = np.empty(shapes[name], np.float32)
        self._library.call("ss_history_read", buffers.handle, [*shapes].index(name), values.ctypes.data)
        return values

    def load(self, buffers: CpuHistory, tensors: Mapping[str, NDArray[Any]]) -> None:
        """See `Executor`."""
        for place, (name, shape) in enumerate(buffers.tensors().items()):
            values = np.ascontiguousarray(tensors[name], np.float32)
            if values.size != math.prod(shape):
                raise ValueError(f"{name} has the shape {values.shape}; want {shape}")
            self._library.call("ss_history_write", buffers.handle, place, values.ctypes.data)


class CpuExtrapolation:
    """Runs `guided-warp` in the library; see `ExtrapolationExecutor`."""

    name = "cpu"

    def __init__(self, model: CpuModel) -> None:
        self._model, self._library = model, model.library

    def upload(self, array: NDArray[Any]) -> NDArray[Any]:
        """See `ExtrapolationExecutor`."""
        return array

    def download(self, tensor: NDArray[Any]) -> NDArray[Any]:
        """See `ExtrapolationExecutor`."""
        return tensor.copy()

    def extrapolate(
        self, frame: Frame, history: Mapping[str, NDArray[Any]]
    ) -> tuple[Float32, Mapping[str, NDArray[Any]]]:
        """See `ExtrapolationExecutor`."""
        width, height = frame.size
        image, motion = np.empty((height, width, 3), np.float32), np.empty((1, 2, height, width), np.float32)
        data, arrays = frame_data(frame)
        shaded = native.ShadedData()
        for name in ("color", "depth", "base_color", "normal", "motion"):
            arrays.append(native.readable(history[f"history.{name}"]))
            setattr(shaded, name, native.Image.of(arrays[-1], planes=True))
        shaded.width, shaded.height = history["history.color"].shape[:1:-1]
        shaded.motion_width, shaded.motion_height = history["history.motion"].shape[:1:-1]
        for name in ("jitter", "motion_jitter"):
            getattr(shaded, name)[:] = history[f"history.{name}"][0].tolist()
        outputs = native.ExtrapolatedOutputs(native.Image.of(image), native.Image.of(motion, planes=True))
        with self._library.interruptible(outputs):
            self._library.call("ss_extrapolate", self._model.handle, data, shaded, outputs)
        del arrays  # kept alive while the library read them
        jitter = np.array([frame.jitter], np.float32)
        return image, {**history, "history.motion": motion, "history.motion_jitter": jitter}


def frame_data(frame: Frame) -> tuple[native.FrameData, list[NDArray[Any]]]:
    """Return a frame for the library, and the arrays that must be kept alive as long as it."""
    images = {name: getattr(frame, name) for name in ("color", "depth", "motion", "reactive")}
    images |= {name: GBUFFERS[f"gbuffer_{name}"].find(frame) for name in native.FRAME_GBUFFERS}
    data, arrays = native.FrameData(*frame.size), []
    for name, array in images.items():
        if array is not None:
            arrays.append(native.readable(array))
            setattr(data, name, native.Image.of(arrays[-1]))
    data.jitter[:] = frame.jitter
    data.exposure, data.pre_exposure = usable_exposure(frame.exposure) or 0.0, frame.pre_exposure
    return data, arrays
