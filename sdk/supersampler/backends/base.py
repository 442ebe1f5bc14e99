"""Protocols of the executors, and locks that are free in a forked child."""

import os
import weakref
from _thread import allocate_lock
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

from numpy.typing import NDArray

from supersampler.frame import Float32, Frame, Size

Buffers = Any
"""The buffers of a history; each executor has its own type."""


class StepRequest(NamedTuple):
    """Checked arguments of a step.

    Attributes:
        frame: the frame.
        display: (W, H).
        history: history after the previous frame; not changed.
        next_history: written to; not `history`.
        image: (H, W, 3), written to.
        aux_outputs: names of auxiliary outputs to return. "aovs": blend the frame's AOVs, which only the GPU
            backend does; it keeps their history.
        adds_samples: 1 adds the frame's samples to the mean of static blocks, 0 does not (extrapolated
            frames). NOISY: see `methods.at_rest`.
        skip: whether frozen tiles may be skipped. The result is the same, bit for bit.
    """

    frame: Frame
    display: Size
    history: Buffers
    next_history: Buffers
    image: Float32
    aux_outputs: Collection[str] = ()
    adds_samples: float = 0.0
    skip: bool = True


class AovRequest(NamedTuple):
    """Arguments of blending the AOVs of one view, after its step.

    Attributes:
        frame: the frame, with AOVs.
        display: (W, H).
        weight: (1, 1, H, W) weight of the history; None: 0.
        history: AOVs after the previous frame, (1, k, H, W); None after a cut. Not changed.
    """

    frame: Frame
    display: Size
    weight: Float32 | None
    history: Float32 | None


class StepReport(NamedTuple):
    """Results of a step besides its image.

    Attributes:
        outputs: the auxiliary outputs, NCHW, by name.
        stages: wall seconds by stage; empty if unknown.
    """

    outputs: Mapping[str, Float32]
    stages: Mapping[str, float] = {}


class Executor(Protocol):
    """Runs steps of one model. It keeps no state that results depend on; threads may share it.

    Attributes:
        name: "onnx", "cpu" or "gpu".
        precision: precision of the network: "fp32", "fp16" or "int8".
    """

    name: str
    precision: str

    def zeros(self, display: Size, render: Size) -> Buffers:
        """Allocate an empty history."""

    def fits(self, buffers: Buffers, display: Size, render: Size) -> bool:
        """Return whether these buffers can hold a history of this display and render size."""

    def step_many(self, steps: Sequence[StepRequest]) -> list[StepReport]:
        """Upscale one frame of each view. No two steps write to the same buffers or image."""

    def required_bytes(self, display: Size, render: Size) -> tuple[int, int | None]:
        """Return the bytes of a history, and of a step's working memory (None if unknown)."""

    def tensor(self, buffers: Buffers, name: str) -> Float32:
        """Return a history tensor of the contract as an array, NCHW."""

    def load(self, buffers: Buffers, tensors: Mapping[str, NDArray[Any]]) -> None:
        """Fill buffers from all history tensors, already checked."""


class ExtrapolationExecutor(Protocol):
    """Runs a model that extrapolates; keeps no state between calls.

    Attributes:
        name: "onnx", "cpu" or "gpu".
    """

    name: str

    def upload(self, array: NDArray[Any]) -> Any:
        """Return a history tensor made from an array, which may share its memory."""

    def download(self, tensor: Any) -> NDArray[Any]:
        """Return a copy of a history tensor as an array."""

    def extrapolate(self, frame: Frame, history: Mapping[str, Any]) -> tuple[Float32, Mapping[str, Any]]:
        """Return the colour of a checked unshaded frame, (h, w, 3), and the next history."""


class ForkSafeLock:
    """A lock for `with fork_safe.lock:`, free in a forked child, which has no thread that could release it.

    The `with` statement must use Python's own lock: no signal handler runs between its acquisition and the
    block, whereas one that raises in an `__enter__` of this class would leave the lock held.

    Attributes:
        lock: Python's lock; a forked child gets a new one.
    """

    def __init__(self) -> None:
        self.lock = allocate_lock()
        _LOCKS.add(self)


_LOCKS: "weakref.WeakSet[ForkSafeLock]" = weakref.WeakSet()


def _renew_all() -> None:
    for fork_safe in _LOCKS:
        fork_safe.lock = allocate_lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew_all)
