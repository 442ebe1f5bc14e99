"""The GPU device: opened once per process, with WebGPU's default limits and the adapter's sizes."""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any

from supersampler.backends.base import ForkSafeLock
from supersampler.errors import DeviceError
from supersampler.frame import Size

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
"""WebGPU's default limits, which every implementation supports: the same shaders run in browsers."""
TEXTURE_SIDE = "max-texture-dimension-2d"
SIZES = TEXTURE_SIDE, "max-storage-buffer-binding-size", "max-buffer-size"
"""Limits that are requested at the adapter's maximum, for large displays."""
_lock = ForkSafeLock()
_devices: list["wgpu.GPUDevice"] = []
"""The device of this process, if one is open."""
_used_by: set[int] = set()
"""Processes that have used a device; a forked child inherits the set of its parent."""


def default_device() -> "wgpu.GPUDevice":
    """Return this process's device on the fastest adapter; `WGPU_ADAPTER_NAME` selects another adapter.

    Raises:
        DeviceError: wgpu is not installed, there is no adapter, or the parent of a forked process has used
            the GPU.
    """
    with _lock.lock:
        _note_process()
        if not _devices:
            _devices.append(_open_device())
        return _devices[0]


def adapter_text() -> str:
    """Return the name of this process's adapter, or "none" and the reason."""
    try:
        return name_of(default_device().adapter)
    except DeviceError as error:
        return f"none: {error}"


def _note_process() -> None:
    """Raise DeviceError in a forked child if its parent has used a device: calls of the driver would hang."""
    _used_by.add(os.getpid())
    if len(_used_by) > 1:
        raise DeviceError(
            "a forked process cannot use the GPU of its parent: start processes with "
            "multiprocessing's 'spawn' or 'forkserver', or fork before the first Upscaler on the GPU"
        )


def _open_device() -> "wgpu.GPUDevice":
    try:
        import wgpu
    except ImportError as error:
        raise DeviceError(f'the GPU backend needs wgpu: pip install "supersampler[gpu]" ({error})') from None
    parse_types_faster()
    try:
        adapter = wgpu.gpu.request_adapter_sync(power_preference="high-performance")
    except Exception as error:  # wgpu raises RuntimeError, or what its native library says
        raise DeviceError(
            "no GPU adapter was found: install the GPU's Vulkan, Metal or DirectX 12 driver; on Linux "
            f"without a GPU, Debian's mesa-vulkan-drivers has a software adapter ({error})"
        ) from None
    lacking = [name for name, need in LIMITS.items() if adapter.limits.get(name, need) < need]
    if lacking:
        raise DeviceError(f"adapter {name_of(adapter)} is below WebGPU's default {', '.join(lacking)}")
    try:
        return adapter.request_device_sync(label="supersampler", required_limits=requested_limits(adapter))
    except Exception as error:
        raise DeviceError(f"adapter {name_of(adapter)} cannot create a device: {error}") from error


def requested_limits(adapter: "wgpu.GPUAdapter") -> dict[str, int]:
    """Return WebGPU's default limits, with the adapter's limits of sizes."""
    return LIMITS | {name: int(adapter.limits.get(name, LIMITS[name])) for name in SIZES}


def name_of(adapter: "wgpu.GPUAdapter") -> str:
    """Return the name, type and API of an adapter: "llvmpipe (CPU, Vulkan)"."""
    info = adapter.info
    return f"{info['device']} ({info['adapter_type']}, {info['backend_type']})"


@contextmanager
def raising(device: "wgpu.GPUDevice", doing: str) -> Iterator[None]:
    """Raise errors of wgpu in a block as DeviceErrors with the adapter and a remedy; forget a lost device."""
    import wgpu

    _note_process()
    try:
        yield
    except (wgpu.GPUError, RuntimeError, MemoryError, OverflowError) as error:
        if isinstance(error, DeviceError):
            raise
        text = " ".join(str(error).split())
        kind, remedy = "failed", "update its driver, or choose executor='auto'"
        if isinstance(error, wgpu.GPUOutOfMemoryError | MemoryError) or "out of memory" in text.lower():
            kind, remedy = "ran out of memory", "choose a smaller display size, or free memory of the GPU"
        elif "lost" in text.lower():
            with _lock.lock:
                if device in _devices:  # `default_device` then opens another one
                    _devices.remove(device)
            kind = "was lost"
            remedy = "histories on it are lost; make a new Upscaler, and load a saved state or reset"
        raise DeviceError(
            f"adapter {name_of(device.adapter)} {kind} {doing}: {remedy} ({text[:400]})"
        ) from error


def check_texture_size(device: "wgpu.GPUDevice", size: Size) -> None:
    """Raise DeviceError if (width, height) exceeds the device's textures."""
    limit, of_adapter = (int(each.limits[TEXTURE_SIDE]) for each in (device, device.adapter))
    if max(size) > limit:
        remedy = "choose a smaller display size, or executor='auto'"
        if limit < of_adapter:
            remedy = f"request the device with {TEXTURE_SIDE} {of_adapter}"
        raise DeviceError(
            f"the device supports textures of at most {limit} pixels a side, the adapter "
            f"{name_of(device.adapter)} of {of_adapter}; want {size[0]}x{size[1]}: {remedy}"
        )


@cache
def parse_types_faster() -> None:
    """Let cffi parse types together with only those definitions whose names they contain.

    Otherwise it parses the names of all of wgpu's two thousand types each time. This replaces a private
    method of cffi, and does nothing if this version of cffi lacks it.
    """
    try:
        from wgpu.backends.wgpu_native._ffi import ffi

        parser = ffi._parser
        known, parse = parser._declarations, parser._parse
    except (ImportError, AttributeError):
        return

    def parse_with_few(source: str) -> Any:
        words = set(re.findall(r"\w+", source))
        parser._declarations = {key: value for key, value in known.items() if words & set(key.split())}
        try:
            return parse(source)
        finally:
            parser._declarations = known

    parser._parse = parse_with_few
