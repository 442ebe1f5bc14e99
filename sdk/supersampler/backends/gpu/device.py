"""The GPU device: opened once per process, with WebGPU's default limits."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from supersampler.errors import DeviceError

if TYPE_CHECKING:
    import wgpu

LIMITS = {
    "max-storage-buffers-per-shader-stage": 8,
    "max-storage-textures-per-shader-stage": 4,
    "max-storage-buffer-binding-size": 128 << 20,
    "max-buffer-size": 256 << 20,
    "max-compute-workgroup-storage-size": 16 << 10,
    "max-compute-invocations-per-workgroup": 256,
    "max-texture-dimension-2d": 8192,
}
"""WebGPU's defaults, which every implementation supports, so that the same shaders run in browsers."""
_lock = threading.Lock()
_devices: dict[int, "wgpu.GPUDevice"] = {}


def default_device() -> "wgpu.GPUDevice":
    """Return this process's device on the fastest adapter; `WGPU_ADAPTER_NAME` chooses another.

    Raises:
        DeviceError: wgpu is not installed, or there is no adapter.
    """
    with _lock:
        process = os.getpid()  # a device does not survive a fork
        if process not in _devices:
            _devices[process] = _open_device()
        return _devices[process]


def forget_device(device: "wgpu.GPUDevice") -> None:
    """Open another device the next time: this one is lost."""
    with _lock:
        for process in [process for process, known in _devices.items() if known is device]:
            del _devices[process]


def _open_device() -> "wgpu.GPUDevice":
    try:
        import wgpu
    except ImportError as error:
        raise DeviceError(f'the GPU backend needs wgpu: pip install "supersampler[gpu]" ({error})') from None
    try:
        adapter = wgpu.gpu.request_adapter_sync(power_preference="high-performance")
    except Exception as error:  # wgpu raises RuntimeError, or what its native library says
        raise DeviceError(
            "no GPU adapter was found: install the GPU's Vulkan, Metal or DirectX 12 driver; on Linux "
            f"without a GPU, Debian's mesa-vulkan-drivers has a software adapter ({error})"
        ) from None
    lacking = [name for name, least in LIMITS.items() if adapter.limits.get(name, least) < least]
    if lacking:
        raise DeviceError(f"adapter {name_of(adapter)} is below WebGPU's default {', '.join(lacking)}")
    try:
        return adapter.request_device_sync(label="supersampler", required_limits=dict(LIMITS))
    except Exception as error:
        raise DeviceError(f"adapter {name_of(adapter)} gives no device: {error}") from error


def name_of(adapter: "wgpu.GPUAdapter") -> str:
    """Return the name of an adapter, its kind and interface: "llvmpipe (CPU, Vulkan)"."""
    info = adapter.info
    return f"{info['device']} ({info['adapter_type']}, {info['backend_type']})"


@contextmanager
def raising(device: "wgpu.GPUDevice", doing: str) -> Iterator[None]:
    """Raise DeviceError, which names the adapter, for errors of wgpu in a block."""
    import wgpu

    try:
        yield
    except (wgpu.GPUError, RuntimeError, MemoryError, OverflowError) as error:
        if isinstance(error, DeviceError):
            raise
        text = " ".join(str(error).split())
        kind = "ran out of memory" if _is_out_of_memory(error, text) else "failed"
        raise DeviceError(f"adapter {name_of(device.adapter)} {kind} {doing}: {text[:400]}") from error


def _is_out_of_memory(error: BaseException, text: str) -> bool:
    return type(error).__name__ == "GPUOutOfMemoryError" or "out of memory" in text.lower()


def storage_limit(device: Any) -> int:
    """Return the largest storage binding in bytes."""
    return int(device.limits["max-storage-buffer-binding-size"])
