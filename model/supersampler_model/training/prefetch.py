"""Frames of a batch's streams, cut in worker processes ahead of the updates that need them.

A frame of a batch has hundreds of small tensors. A worker packs the tensors of its streams into one buffer,
which moves to another process, or to a GPU, in one copy.
"""

import atexit
import pickle
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils import _pytree as pytree
from torch.utils.data import DataLoader, IterableDataset, get_worker_info

from supersampler.errors import SupersamplerError
from supersampler_model.data.errors import DataError
from supersampler_model.training.crops import CropStream, StreamPosition

ALIGNMENT = 64  # bytes
AHEAD = 8  # frames that each worker cuts in advance


@dataclass(frozen=True)
class Slot:
    """Place of a tensor in a buffer: first byte, shape and type."""

    start: int
    shape: torch.Size
    dtype: torch.dtype

    def of(self, buffer: Tensor) -> Tensor:
        """Return the tensor, a view of the buffer."""
        size = self.shape.numel() * self.dtype.itemsize
        return buffer[self.start : self.start + size].view(self.dtype).view(self.shape)


@dataclass(frozen=True)
class PackedCrops:
    """One frame of some crops, in one buffer.

    A worker passes on the buffer's name and little else. A pipe takes so few bytes all at once or not at all:
    if a worker was killed in the middle of a message, the trainer would wait for the rest forever.
    """

    buffer: Tensor  # bytes of all tensors, and of the pickled rest
    end: int  # of the tensors

    @classmethod
    def of(cls, crops: list[Any], positions: list[StreamPosition]) -> "PackedCrops":
        """Pack crops, which are nested tuples and dictionaries of tensors and other values.

        `positions` are those of each stream after this frame.
        """
        tensors: dict[Slot, Tensor] = {}
        end = 0

        def place(tensor: Tensor) -> Slot:
            nonlocal end
            slot = Slot(end, tensor.shape, tensor.dtype)
            tensors[slot] = tensor
            end += _aligned(tensor.nbytes)
            return slot

        slots = pytree.tree_map_only(Tensor, place, crops)
        rest = pickle.dumps(list(zip(slots, positions, strict=True)))
        buffer = torch.empty(end + _aligned(len(rest)), dtype=torch.uint8)
        for slot, tensor in tensors.items():
            slot.of(buffer).copy_(tensor)
        buffer.numpy()[end : end + len(rest)] = np.frombuffer(rest, np.uint8)
        return cls(buffer, end)

    def pin_memory(self) -> "PackedCrops":
        """Return a copy in page-locked memory, for asynchronous copies to a GPU; the loader calls this."""
        return replace(self, buffer=self.buffer.pin_memory())

    def on(self, device: torch.device) -> list[tuple[Any, StreamPosition]]:
        """Return the crops with their tensors on a device, and the position of each stream."""
        parts = pickle.loads(self.buffer[self.end :].numpy().tobytes())  # noqa: S301  # of our own process
        buffer = self.buffer[: self.end].to(device, non_blocking=True)
        return list(pytree.tree_map_only(Slot, lambda slot: slot.of(buffer), parts))


class _Frames(IterableDataset[PackedCrops | SupersamplerError]):
    """Frames of all streams; each of n workers cuts every n-th stream.

    The last item may be an error, because torch passes on only errors whose one argument is the message.
    """

    def __init__(self, streams: Sequence[CropStream]) -> None:
        self._streams = streams

    def __iter__(self) -> Iterator[PackedCrops | SupersamplerError]:
        worker = get_worker_info()
        own = self._streams if worker is None else self._streams[worker.id :: worker.num_workers]
        iterators = [iter(stream) for stream in own]
        while True:
            try:
                crops = [next(iterator) for iterator in iterators]
            except SupersamplerError as error:
                yield error
                return
            yield PackedCrops.of(crops, [replace(stream.position) for stream in own])


def frames_of(
    streams: Sequence[CropStream], device: torch.device, workers: int
) -> Iterator[list[tuple[Any, StreamPosition]]]:
    """Yield the next frame of each stream, with the stream's position after it.

    Worker processes cut crops ahead. Without workers, crops are cut on demand. The crops are the same.

    Raises:
        SupersamplerError: of a stream, such as a damaged frame, from any process.
        DataError: a worker process has ended.
    """
    workers = min(workers, len(streams))
    loader: DataLoader[PackedCrops | SupersamplerError] = DataLoader(
        _Frames(streams),
        batch_size=None,
        num_workers=workers,
        collate_fn=_as_is,
        pin_memory=device.type == "cuda",
        worker_init_fn=_ignore_signals,
        prefetch_factor=AHEAD if workers else None,
    )
    with _end_of_a_worker_as_data_error():
        parts: Any = iter(loader)
        if workers:
            _stop_watching(parts)
    turns = max(workers, 1)  # from each worker in turn
    end: Callable[[], None] = parts._shutdown_workers if workers else lambda: None
    atexit.register(end)  # by itself, torch leaves them to a SIGTERM at exit, which they ignore
    try:
        while True:
            frame: list[Any] = [None] * len(streams)
            for turn in range(turns):
                with _end_of_a_worker_as_data_error():
                    packed = next(parts)
                if isinstance(packed, SupersamplerError):
                    raise packed
                frame[turn::turns] = packed.on(device)
            yield frame
    finally:
        atexit.unregister(end)
        end()


@contextmanager
def _end_of_a_worker_as_data_error() -> Iterator[None]:
    try:
        yield
    except (ConnectionError, EOFError, RuntimeError) as error:  # the first two while it passes a buffer on
        if isinstance(error, RuntimeError) and not str(error).startswith("DataLoader worker"):
            raise
        what = f"A worker process that cuts training crops has ended: {str(error).rstrip('. ')}."
        raise DataError(f"{what} Was there not enough memory? Run again to resume.") from error


def _stop_watching(parts: Any) -> None:
    """Stop torch from raising the end of a worker in a signal handler, and so at any line of a trainer.

    The wait for a frame of that worker notices it, too, within five seconds.
    """
    torch._C._remove_worker_pids(id(parts))
    parts._worker_pids_set = False


def _aligned(size: int) -> int:
    return -(-size // ALIGNMENT) * ALIGNMENT


def _as_is(crops: Any) -> Any:
    return crops


def _ignore_signals(_worker: int) -> None:
    """Leave Ctrl-C and a scheduler's SIGTERM, which reach all processes, to the trainer."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
