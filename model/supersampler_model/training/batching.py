"""Run a stage of a method, which takes one crop, on many: those of equal shapes as one batch.

A stage is hundreds of small operations. A batch needs as many of them as one crop does, each larger: less
overhead on a CPU, and much less on a GPU.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import torch
from torch import Tensor

Result = TypeVar("Result")


class _Tensor(NamedTuple):
    """Stands for a tensor; a batch needs equal ones."""

    shape: torch.Size
    dtype: torch.dtype


class _Node(NamedTuple):
    """A tuple, list or mapping of parts."""

    kind: type[Any]
    names: tuple[Any, ...]  # of a mapping
    parts: tuple[Any, ...]


def in_batches(stage: Callable[..., Result], crops: Sequence[tuple[Any, ...]]) -> list[Result]:
    """Return `stage(*crop)` of each crop.

    Args:
        stage: a function of tensors, and of named tuples, lists and mappings of them; what it does must not
            depend on values of tensors. Other values in them, as sizes, are the same in one batch.
        crops: arguments.
    """
    batches: dict[Any, list[int]] = {}
    found: list[list[Tensor]] = []
    for index, crop in enumerate(crops):
        found.append([])
        batches.setdefault(_without_tensors(crop, found[-1]), []).append(index)
    results: dict[int, Result] = {}
    for structure, members in batches.items():
        columns = zip(*(found[i] for i in members), strict=True)
        batch = _batch(stage, structure, [torch.stack(column) for column in columns])
        results |= dict(zip(members, batch, strict=True))
    return [results[index] for index in range(len(crops))]


def _batch(stage: Callable[..., Result], structure: Any, stacked: list[Tensor]) -> Iterator[Result]:
    """Yield the results of one batch, from its tensors, the crops along the first axis."""
    returned: list[Any] = []

    def run(*tensors: Tensor) -> tuple[Tensor, ...]:
        outputs: list[Tensor] = []
        returned.append(_without_tensors(stage(*_with_tensors(structure, iter(tensors))), outputs))
        return tuple(outputs)

    outputs = torch.func.vmap(run)(*stacked)
    for tensors in zip(*(output.unbind() for output in outputs), strict=True):
        yield _with_tensors(returned[0], iter(tensors))


def _without_tensors(value: Any, tensors: list[Tensor]) -> Any:
    """Return a hashable description of `value`; its tensors are added to the list."""
    if isinstance(value, Tensor):
        tensors.append(value)
        return _Tensor(value.shape, value.dtype)
    if isinstance(value, Mapping):
        parts = tuple(_without_tensors(part, tensors) for part in value.values())
        return _Node(dict, tuple(value), parts)
    if isinstance(value, tuple | list):
        return _Node(type(value), (), tuple(_without_tensors(part, tensors) for part in value))
    return value


def _with_tensors(structure: Any, tensors: Iterator[Tensor]) -> Any:
    """Inverse of `_without_tensors`."""
    if isinstance(structure, _Tensor):
        return next(tensors)
    if not isinstance(structure, _Node):
        return structure
    parts = [_with_tensors(part, tensors) for part in structure.parts]
    if structure.kind is dict:
        return dict(zip(structure.names, parts, strict=True))
    return structure.kind(*parts) if hasattr(structure.kind, "_fields") else structure.kind(parts)
