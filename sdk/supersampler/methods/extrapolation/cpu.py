"""CPU backend of `guided-warp`: reads the last shaded frame, then computes each pixel of this one."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.kernel_loader import load_kernels
from supersampler.backends.cpu.layout import LANES, SHADED_PLANES
from supersampler.backends.cpu.memory import address, aligned
from supersampler.backends.cpu.resample_tables import up_to
from supersampler.backends.cpu.structs import pack
from supersampler.backends.cpu.threads import ThreadPool
from supersampler.backends.cpu.workspaces import Workspaces
from supersampler.backends.onnx.session import image_of
from supersampler.frame import Float32, Frame, Size
from supersampler.methods.cpu_checks import are_rings
from supersampler.methods.extrapolation.spec import GUIDED_WARP
from supersampler.methods.extrapolation.structs import ExtrapolationOutput, Rings, UnshadedFrame
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.spec import constants_array

KERNELS = "methods.extrapolation.kernels"
_AROUND = ((0, -1), (-1, 0), (1, 0), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1))


class _Space:
    """Buffers for shaded frames of one size; `scratch`: what one thread works on."""

    def __init__(self, shaded: Size, threads: int) -> None:
        self.stride = up_to(shaded[0], LANES)
        self.samples = aligned((SHADED_PLANES, shaded[1], self.stride))
        self.scratch = [(np.zeros(LANES, np.int32), np.zeros(5 * LANES, np.float32)) for _ in range(threads)]


class GuidedWarpCpu:
    """Runs `guided-warp`; see `ExtrapolationExecutor`.

    Args:
        info: the model.
        pool: threads that compute.
    """

    name = "cpu"

    def __init__(self, info: ModelInfo, pool: ThreadPool) -> None:
        names = f"{KERNELS}.extrapolate_rows", f"{KERNELS}.read_shaded"
        self._extrapolate_rows, self._read_shaded = load_kernels(*names).values()
        self._pool = pool
        config = info.config
        self._constants = constants_array(GUIDED_WARP, config)
        places = [(0, 0), *((s * x, s * y) for s in config["strides"] for x, y in _AROUND)]
        x, y = np.array(places, np.float32).T.copy()
        self._rings = Rings(x, y, np.array(config["strides"], np.int32), len(config["strides"]))
        self._spaces = Workspaces(lambda shaded: _Space(shaded, pool.threads))

    @staticmethod
    def draws(config: Mapping[str, Any]) -> bool:
        """Whether the kernels draw with this GuidedWarpConfig: rings from near to far, four samples kept."""
        return config.get("taps") == 4 and are_rings(config.get("strides"))

    def placed(self, array: NDArray[Any]) -> NDArray[Any]:
        """See `ExtrapolationExecutor`."""
        return array

    def copied(self, tensor: NDArray[Any]) -> NDArray[Any]:
        """See `ExtrapolationExecutor`."""
        return tensor.copy()

    def draw(
        self, frame: Frame, past: Mapping[str, NDArray[Any]]
    ) -> tuple[Float32, Mapping[str, NDArray[Any]]]:
        """See `ExtrapolationExecutor`."""
        color, before = past["history.color"], past["history.motion"]
        (h, w), (then_h, then_w) = frame.depth.shape, color.shape[2:]
        image, total = np.empty((h, w, 3), np.float32), np.empty((1, 2, h, w), np.float32)
        jitters = (frame.jitter, past["history.jitter"][0], past["history.motion_jitter"][0])
        sizes = (then_w, then_h, *before.shape[:1:-1])
        offsets = [offset for jitter in jitters for offset in jitter]
        numbers = np.array([*self._constants, *sizes, *offsets, before.any(), _has_depth(past)], np.float32)
        base_color, normal, depth, motion = (
            np.ascontiguousarray(image_of(frame, name), np.float32)
            for name in ("gbuffer_base_color", "gbuffer_normal", "depth", "motion")
        )
        with self._spaces.borrow((then_w, then_h)) as space:
            stride, samples = space.stride, address(space.samples)
            shaded = [address(past[f"history.{name}"]) for name in ("color", "base_color", "normal", "depth")]

            unshaded = pack(UnshadedFrame(base_color, normal, depth, motion, w, h, stride))
            inputs = unshaded, address(before), samples, address(numbers), pack(self._rings)
            output = pack(ExtrapolationOutput(total, image))
            scratch = [(address(room), address(line)) for room, line in space.scratch]

            def read(y0: int, y1: int, _: int) -> None:
                self._read_shaded(*shaded, address(numbers), then_w, then_h, stride, y0, y1, samples)

            def extrapolate(y0: int, y1: int, worker: int) -> None:
                self._extrapolate_rows(*inputs, *scratch[worker], output, y0, y1)

            self._pool.run_rows("preprocess", then_h, read)
            self._pool.run_rows("compute", h, extrapolate)
        left = {"history.motion": total, "history.motion_jitter": np.array([frame.jitter], np.float32)}
        return image, {**past, **left}


def _has_depth(past: Mapping[str, NDArray[Any]]) -> bool:
    """Whether the shaded frame has usable depth anywhere."""
    return any(((row >= 0.0) & (row <= 1e30)).any() for row in past["history.depth"][0, 0])
