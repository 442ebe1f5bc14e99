"""Timestamps of a GPU: around a part of a command encoder, and around each of its dispatches."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.gpu.device import default_device, name_of, requested_limits
from supersampler.errors import DeviceError

if TYPE_CHECKING:
    import wgpu

TIMESTAMPS = "timestamp-query"
_RESOLVE, _COPY_SRC = 512, 4  # usages, as WebGPU numbers them


def device_with_timestamps() -> "wgpu.GPUDevice":
    """Open another device on the adapter of `default_device`.

    Raises:
        DeviceError: there is no device, or it has no timestamp queries.
    """
    adapter = default_device().adapter
    if TIMESTAMPS not in adapter.features:
        raise DeviceError(f"adapter {name_of(adapter)} has no timestamp queries: steps cannot be timed on it")
    return adapter.request_device_sync(
        required_features=[TIMESTAMPS], required_limits=requested_limits(adapter)
    )


class Stopwatch:
    """Up to `max_pairs` pairs of timestamps in one command buffer, on a `device_with_timestamps`."""

    def __init__(self, device: "wgpu.GPUDevice", max_pairs: int) -> None:
        self._device, self._pairs = device, 0
        self._queries = device.create_query_set(type="timestamp", count=2 * max_pairs)
        self._times = device.create_buffer(size=16 * max_pairs, usage=_RESOLVE | _COPY_SRC)
        self._period = _nanoseconds(device)

    def around(self, encoder: "wgpu.GPUCommandEncoder", encode: Callable[[], object]) -> None:
        """Time the commands that `encode` encodes, between two empty passes."""
        first = 2 * self._pairs
        self._pairs += 1
        self._pass(encoder, beginning_of_pass_write_index=first).end()
        encode()
        self._pass(encoder, end_of_pass_write_index=first + 1).end()

    def timed_pass(self, encoder: "wgpu.GPUCommandEncoder") -> "wgpu.GPUComputePassEncoder":
        """Begin a compute pass that is timed as a whole."""
        first = 2 * self._pairs
        self._pairs += 1
        return self._pass(encoder, beginning_of_pass_write_index=first, end_of_pass_write_index=first + 1)

    def submit(self, encoder: "wgpu.GPUCommandEncoder") -> NDArray[np.float64]:
        """Submit the commands, wait, and return the milliseconds of each pair, in order."""
        pairs, self._pairs = self._pairs, 0
        encoder.resolve_query_set(self._queries, 0, 2 * pairs, self._times, 0)
        self._device.queue.submit([encoder.finish()])
        read = self._device.queue.read_buffer(self._times, 0, 16 * pairs)
        begin, end = np.frombuffer(read, np.uint64).reshape(-1, 2).T
        return 1e-6 * self._period * (end - begin).astype(np.float64)

    def _pass(self, encoder: "wgpu.GPUCommandEncoder", **writes: int) -> "wgpu.GPUComputePassEncoder":
        return encoder.begin_compute_pass(timestamp_writes={"query_set": self._queries, **writes})


def _nanoseconds(device: "wgpu.GPUDevice") -> float:
    """Return the unit of timestamps, nanoseconds; wgpu's native library passes the driver's on."""
    from wgpu.backends.wgpu_native._ffi import lib

    return float(lib.wgpuQueueGetTimestampPeriod(device.queue._internal))


class EachDispatch:
    """A command encoder that times each dispatch in a pass of its own."""

    def __init__(self, encoder: "wgpu.GPUCommandEncoder", watch: Stopwatch) -> None:
        self._encoder, self._watch = encoder, watch
        self._device = encoder._device  # as wgpu's encoders have it

    def __getattr__(self, name: str) -> Any:
        return getattr(self._encoder, name)

    def begin_compute_pass(self) -> "_Dispatches":
        """Begin a compute pass, which is split into a timed one per dispatch."""
        return _Dispatches(self._encoder, self._watch)


class _Dispatches:
    """A compute pass, which is split into a timed one per dispatch."""

    def __init__(self, encoder: "wgpu.GPUCommandEncoder", watch: Stopwatch) -> None:
        self._encoder, self._watch = encoder, watch
        self._before: list[tuple[str, tuple[Any, ...]]] = []

    def set_pipeline(self, *given: Any) -> None:
        self._before.append(("set_pipeline", given))

    def set_bind_group(self, *given: Any) -> None:
        self._before.append(("set_bind_group", given))

    def dispatch_workgroups(self, *count: int) -> None:
        compute = self._watch.timed_pass(self._encoder)
        for name, given in self._before:
            getattr(compute, name)(*given)
        compute.dispatch_workgroups(*count)
        compute.end()
        self._before.clear()

    def end(self) -> None:
        """Do nothing: each dispatch has ended its pass."""
