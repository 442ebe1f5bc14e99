"""CPU backend of `guided-warp`: one pass reads the last shaded frame, another computes the unshaded one."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.kernel_loader import load_kernels
from supersampler.backends.cpu.layout import LANES, SHADED_PLANES
from supersampler.backends.cpu.memory import Workspaces, address, aligned
from supersampler.backends.cpu.resample_tables import up_to
from supersampler.backends.cpu.structs import pack
from supersampler.backends.cpu.threads import ThreadPool
from supersampler.backends.onnx.session import image_of
from supersampler.frame import Float32, Frame, Size
from supersampler.methods.constants import MAX_DEPTH
from supersampler.methods.extrapolation.spec import GUIDED_WARP, NEIGHBOURS
from supersampler.methods.extrapolation.structs import ExtrapolationOutput, Rings, UnshadedFrame
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.spec import constants_array

KERNELS = "methods.extrapolation.kernels"


class _Space:
    """Buffers for shaded frames of one size; `scratch` has sample offsets and output lines per thread."""

    def __init__(self, shaded: Size, threads: int) -> None:
        self.stride = up_to(shaded[0], LANES)
        self.samples = aligned((SHADED_PLANES, shaded[1], self.stride))
        self.scratch = [(np.zeros(LANES, np.int32), np.zeros(5 * LANES, np.float32)) for _ in range(threads)]


class GuidedWarpCpu:
    """Runs `guided-warp`; see `ExtrapolationExecutor`.

    Args:
        info: the model.
        pool: the threads that run the kernels.
    """

    name = "cpu"

    def __init__(self, info: ModelInfo, pool: ThreadPool) -> None:
        names = f"{KERNELS}.extrapolate_rows", f"{KERNELS}.read_shaded"
        self._extrapolate_rows, self._read_shaded = load_kernels(*names).values()
        self._pool = pool
        self._constants, strides = constants_array(GUIDED_WARP, info.config), info.config["strides"]
        offsets = [(0, 0), *((s * x, s * y) for s in strides for x, y in NEIGHBOURS)]
        x, y = np.array(offsets, np.float32).T.copy()
        self._rings = Rings(x, y, np.array(strides, np.int32), len(strides))
        self._spaces = Workspaces(lambda shaded: _Space(shaded, pool.threads))

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
        color, previous_motion = history["history.color"], history["history.motion"]
        (h, w), (shaded_h, shaded_w) = frame.depth.shape, color.shape[2:]
        image, next_motion = np.empty((h, w, 3), np.float32), np.empty((1, 2, h, w), np.float32)
        jitters = (frame.jitter, history["history.jitter"][0], history["history.motion_jitter"][0])
        has_depth = any(((row >= 0.0) & (row <= MAX_DEPTH)).any() for row in history["history.depth"][0, 0])
        numbers = np.array(
            [
                *self._constants, shaded_w, shaded_h, *previous_motion.shape[:1:-1],
                *(offset for jitter in jitters for offset in jitter), previous_motion.any(), has_depth,
            ],
            np.float32,
        )  # fmt: skip
        base_color, normal, depth, motion = (
            np.ascontiguousarray(image_of(frame, name), np.float32)
            for name in ("gbuffer_base_color", "gbuffer_normal", "depth", "motion")
        )
        shaded = [address(history[f"history.{name}"]) for name in ("color", "base_color", "normal", "depth")]
        with self._spaces.borrow((shaded_w, shaded_h)) as space:
            stride, samples = space.stride, address(space.samples)
            unshaded = pack(UnshadedFrame(base_color, normal, depth, motion, w, h, stride))
            inputs = unshaded, address(previous_motion), samples, address(numbers), pack(self._rings)
            output = pack(ExtrapolationOutput(next_motion, image))
            scratch = [(address(offsets), address(line)) for offsets, line in space.scratch]

            def read(y0: int, y1: int, _: int) -> None:
                self._read_shaded(*shaded, address(numbers), shaded_w, shaded_h, stride, y0, y1, samples)

            def extrapolate(y0: int, y1: int, worker: int) -> None:
                self._extrapolate_rows(*inputs, *scratch[worker], output, y0, y1)

            self._pool.run_rows("preprocess", shaded_h, read)
            self._pool.run_rows("compute", h, extrapolate)
        if frame.pre_exposure != 1.0:
            image *= np.float32(frame.pre_exposure)
        motion_jitter = np.array([frame.jitter], np.float32)
        return image, {**history, "history.motion": next_motion, "history.motion_jitter": motion_jitter}
