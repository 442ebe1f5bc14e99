"""Training on several processes: each steps its share of the batch, and all have the weights of one process.

Means over the batch are means over processes: their denominators are shared, and so are the statistics of
batch normalisation, with their gradients. `torch.nn.SyncBatchNorm` runs on GPUs alone.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from typing import Any, cast

import torch
from torch import Tensor, nn
from torch import distributed as dist

WAIT = timedelta(days=1)  # for the first process's validation; torchrun ends all where one fails


def join_processes() -> None:
    """Join the processes that torchrun started, if it did; each computes on its part of the cores."""
    if "RANK" not in os.environ:
        return
    if torch.cuda.is_available():
        torch.cuda.set_device(int(os.environ["LOCAL_RANK"]))
    dist.init_process_group("nccl" if torch.cuda.is_available() else "gloo", timeout=WAIT)
    torch.set_num_threads(max((os.cpu_count() or 1) // int(os.environ["LOCAL_WORLD_SIZE"]), 1))


def leave_processes() -> None:
    """Wait for all processes, and leave them."""
    if dist.is_initialized():
        dist.barrier()
        dist.destroy_process_group()


@contextmanager
def one_process_first() -> Iterator[None]:
    """Run the block on the first process, then on all others."""
    if process_rank() > 0:
        dist.barrier()
    yield
    if process_rank() == 0 and dist.is_initialized():
        dist.barrier()


def process_count() -> int:
    """Return the number of processes; 1 without torchrun."""
    return dist.get_world_size() if dist.is_initialized() else 1


def process_rank() -> int:
    """Return the number of this process, from 0 on."""
    return dist.get_rank() if dist.is_initialized() else 0


def mean_of_processes(value: Tensor) -> Tensor:
    """Return the mean over processes, without gradient: of gradients, and of denominators of means."""
    if process_count() == 1:
        return value
    total = value.detach().clone()
    dist.all_reduce(total)
    return total / process_count()


def gather_on_first(value: Any) -> list[Any]:
    """Return the values of all processes, in their order, on the first; an empty list on others."""
    if process_count() == 1:
        return [value]
    values: list[Any] = [None] * process_count()
    dist.gather_object(value, values if process_rank() == 0 else None)
    return values if process_rank() == 0 else []


def share_batch_norm(module: nn.Module) -> None:
    """Replace batch normalisation layers in a module by `SharedBatchNorm`, if there are several processes."""
    if process_count() == 1:
        return
    for name, child in module.named_children():
        if isinstance(child, nn.BatchNorm2d):
            setattr(module, name, SharedBatchNorm.of(child))
        else:
            share_batch_norm(child)


@contextmanager
def uncounted() -> Iterator[None]:
    """Within the block, batch normalisation takes part in the exchange of statistics with a weight of 0."""
    SharedBatchNorm.counted = False
    try:
        yield
    finally:
        SharedBatchNorm.counted = True


class SharedBatchNorm(nn.BatchNorm2d):
    """Batch normalisation with the statistics of all processes' crops.

    Attributes:
        counted: whether the crops of this process count; see `uncounted`.
    """

    counted = True

    @classmethod
    def of(cls, layer: nn.BatchNorm2d) -> "SharedBatchNorm":
        """Return one with the parameters, the buffers and the settings of a layer."""
        shared = cls.__new__(cls)
        shared.__dict__.update(layer.__dict__)
        return shared

    def forward(self, x: Tensor) -> Tensor:
        """Normalise (n, c, h, w); in training by this batch, and the running statistics follow."""
        if not self.training:
            return super().forward(x)
        wide, counted = x.float(), float(self.counted)
        count = mean_of_processes(wide.new_tensor(counted * x[:, 0].numel())) * process_count()
        if count == 0.0:
            return x
        mean = _sum_of_processes(counted * wide.sum(dim=(0, 2, 3))) / count
        centred = wide - mean[:, None, None]
        variance = _sum_of_processes(counted * (centred * centred).sum(dim=(0, 2, 3))) / count
        with torch.no_grad():
            self._follow(mean, variance * count / (count - 1.0))
        scale = self.weight * (variance + self.eps).rsqrt()
        return (centred * scale[:, None, None] + self.bias[:, None, None]).to(x.dtype)

    def _follow(self, mean: Tensor, variance: Tensor) -> None:
        running = cast(Tensor, self.running_mean), cast(Tensor, self.running_var)
        cast(Tensor, self.num_batches_tracked).add_(1)
        for kept, value in zip(running, (mean, variance), strict=True):
            kept.lerp_(value, cast(float, self.momentum))


class _Sum(torch.autograd.Function):
    """Sum over processes. The gradient is summed too, because the loss of each process depends on the sum."""

    @staticmethod
    def forward(ctx: Any, value: Tensor) -> Tensor:  # noqa: ARG004  # autograd's interface
        """Return the sum."""
        total = value.clone()
        dist.all_reduce(total)
        return total

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Tensor:  # noqa: ARG004
        """Return the sum of the gradients."""
        total = gradient.clone()
        dist.all_reduce(total)
        return total


def _sum_of_processes(value: Tensor) -> Tensor:
    summed: Tensor = _Sum.apply(value)  # type: ignore[no-untyped-call]
    return summed
