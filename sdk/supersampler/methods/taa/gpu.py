"""GPU backend of `taa`."""

from typing import TYPE_CHECKING

from supersampler.backends.gpu.executor import GpuExecutor, PassSpec
from supersampler.backends.gpu.history import HistoryLayout, Plane, of_plane
from supersampler.backends.gpu.memory import MemorySpec, TextureSpec
from supersampler.frame import Size
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.spec import constants_of
from supersampler.methods.taa.spec import TAA

if TYPE_CHECKING:
    import wgpu

LAYOUT = HistoryLayout(TAA, {"pixels": Plane("color")}, {"color": of_plane("pixels", 0, 1, 2)})


class TaaGpu(GpuExecutor):
    """Runs `taa`; see `Executor`.

    Args:
        info: the model.
        device: to run on; None is that of the process.
    """

    def __init__(self, info: ModelInfo, device: "wgpu.GPUDevice | None" = None) -> None:
        constants = {name: info.config[name] for name in constants_of(TAA)}
        passes = PassSpec("boxes", "render"), PassSpec("blend")
        super().__init__(LAYOUT, "supersampler.methods.taa", constants, passes, device)

    def work_specs(self, render: Size, display: Size) -> dict[str, MemorySpec]:  # noqa: ARG002
        """See `GpuExecutor`."""
        return {name: TextureSpec(render) for name in ("tones", "lows", "highs", "longest")}
