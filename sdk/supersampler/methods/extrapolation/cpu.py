"""`guided-warp` on a processor: the samples of the last shaded frame, then each pixel of this one."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.kernel_loader import load_kernels
from supersampler.backends.cpu.layout import GUIDED, LANES
from supersampler.backends.cpu.memory import address, aligned
from supersampler.backends.cpu.resample_tables import up_to
from supersampler.backends.cpu.threads import ThreadPool
from supersampler.backends.cpu.workspaces import Workspaces
from supersampler.backends.onnx.session import image_of
from supersampler.frame import Float32, Frame, Size
from supersampler.methods.cpu_checks import are_rings
from supersampler.methods.extrapolation.spec import GUIDED_WARP
from supersampler.methods.model_file import ModelInfo
from supersampler.methods.spec import constants_array

KERNELS = "methods.extrapolation.kernels"
_AROUND = ((0, -1), (-1, 0), (1, 0), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1))


class _Space:
    """Buffers for shaded frames of one size; `scratch`: what one thread works on."""

    def __init__(self, shaded: Size, threads: int) -> None:
        self.stride = up_to(shaded[0], LANES)
        self.samples = aligned((GUIDED, shaded[1], self.stride))
        self.scratch = [(np.zeros(LANES, np.int32), np.zeros(5 * LANES, np.float32)) for _ in range(threads)]


class GuidedWarpCpu:
    """Runs `guided-warp`; see `ExtrapolationExecutor`.

    Args:
        info: the model.
        bands: threads.
    """

    name = "cpu"

    def __init__(self, info: ModelInfo, bands: ThreadPool) -> None:
        kernels = load_kernels(f"{KERNELS}.draw", f"{KERNELS}.enter")
        self._enter, self._draw, self._bands = (
            kernels[f"{KERNELS}.enter"],
            kernels[f"{KERNELS}.draw"],
            bands,
        )
        config = info.config
        self._constants = constants_array(GUIDED_WARP, config)
        self._strides = np.array(config["strides"], np.int32)
        places = [(0, 0), *((s * x, s * y) for s in config["strides"] for x, y in _AROUND)]
        self._across, self._down = np.array(places, np.float32).T.copy()
        self._spaces = Workspaces(lambda shaded: _Space(shaded, bands.threads))

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
        numbers = np.array([*self._constants, *sizes, *offsets, before.any()], np.float32)
        names = ("gbuffer_base_color", "gbuffer_normal", "depth", "motion")
        given = [np.ascontiguousarray(image_of(frame, name), np.float32) for name in names]
        with self._spaces.borrow((then_w, then_h)) as space:
            stride, samples = space.stride, address(space.samples)
            shaded = [address(past[f"history.{name}"]) for name in ("color", "base_color", "normal", "depth")]

            def enter(y0: int, y1: int, _: int) -> None:
                self._enter(*shaded, address(numbers), then_w, then_h, stride, y0, y1, samples)

            def draw(y0: int, y1: int, worker: int) -> None:
                tables = (numbers, self._across, self._down, self._strides)
                self._draw(
                    *map(address, given), address(before), samples, *map(address, tables),
                    len(self._strides), w, h, stride, *map(address, space.scratch[worker]), y0, y1,
                    address(total), address(image),
                )  # fmt: skip

            self._bands.run("read", then_h, enter)
            self._bands.run("draw", h, draw)
        left = {"history.motion": total, "history.motion_jitter": np.array([frame.jitter], np.float32)}
        return image, {**past, **left}
