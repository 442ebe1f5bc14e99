"""GPU backend of `taau`."""

from typing import TYPE_CHECKING

from supersampler.backends.gpu.convergence import (
    CONVERGENCE_CHANNELS,
    CONVERGENCE_PASSES,
    CONVERGENCE_PLANES,
    preprocess,
    sample_specs,
)
from supersampler.backends.gpu.executor import GpuExecutor, PassSpec
from supersampler.backends.gpu.history import HistoryLayout, Plane, of_plane
from supersampler.backends.gpu.memory import MemorySpec
from supersampler.frame import Size
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.spec import constants_of
from supersampler.methods.taau.spec import FLASH, FLASH_MEMORY, LEAST_FLASH, TAAU

if TYPE_CHECKING:
    import wgpu

LAYOUT = HistoryLayout(
    TAAU,
    {
        "pixels": Plane("color"),
        "power": Plane("samples", 1, None),
        "surface": Plane("surface"),
        **CONVERGENCE_PLANES,
    },
    {
        "color": of_plane("pixels", 0, 1, 2),
        "samples": (("pixels", 3), ("power", 0)),
        "surface": of_plane("surface", 1, 2, 3),
        **CONVERGENCE_CHANNELS,
    },
)


class TaauGpu(GpuExecutor):
    """Runs `taau`; see `Executor`.

    Args:
        info: the model.
        device: to run on; None is that of the process.
    """

    def __init__(self, info: ModelInfo, device: "wgpu.GPUDevice | None" = None) -> None:
        constants = {name: info.config[name] for name in constants_of(TAAU)}
        constants |= {"flash": FLASH, "least_flash": LEAST_FLASH, "flash_memory": FLASH_MEMORY}
        passes = preprocess("shade"), PassSpec("light", "one", (1, 1)), *CONVERGENCE_PASSES, PassSpec("blend")
        super().__init__(LAYOUT, "supersampler.methods.taau", constants, passes, device)

    def work_specs(self, render: Size, display: Size) -> dict[str, MemorySpec]:  # noqa: ARG002
        """See `GpuExecutor`."""
        return sample_specs(render)
