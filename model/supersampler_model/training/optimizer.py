"""The optimizer: Muon (Jordan et al. 2024) for 1x1 convolutions, which are matrices, AdamW for all others.

A few directions dominate the gradients of a recurrent image loss. Muon replaces a gradient by the nearest
orthogonal matrix, which updates all directions equally. Steps are scaled as in Liu et al. 2025, section 2.2,
so that both updates share one learning rate. `torch.optim.Muon` computes its update in bfloat16 and accepts
matrices only; the released weights were trained in float32.
"""

from collections.abc import Iterable
from typing import Any

import torch
from torch import Tensor, nn

MOMENTUM = 0.95
BETAS = (0.9, 0.99)
TINY = 1e-8
_STEPS = 5
_COEFFICIENTS = (3.4445, -4.775, 2.0315)  # of the quintic iteration whose limit is orthogonal


class Muon(torch.optim.Optimizer):
    """One optimizer for a whole network, with decoupled weight decay of matrices."""

    def __init__(self, parameters: Iterable[nn.Parameter], *, rate: float, decay: float) -> None:
        super().__init__(parameters, {"lr": rate, "decay": decay})

    @torch.no_grad()
    def step(self) -> None:  # type: ignore[override]  # takes no closure
        """Update all parameters that have a gradient."""
        for group in self.param_groups:
            for parameter in (p for p in group["params"] if p.grad is not None):
                if is_matrix(parameter):
                    parameter.mul_(1.0 - group["lr"] * group["decay"])
                step = _orthogonal_step if is_matrix(parameter) else _adam_step
                parameter.add_(step(parameter.grad, self.state[parameter]), alpha=-group["lr"])


def is_matrix(parameter: Tensor) -> bool:
    """Return whether a weight belongs to a 1x1 convolution."""
    return parameter.ndim == 4 and parameter.shape[2:] == (1, 1)


def orthogonalised(matrix: Tensor) -> Tensor:
    """Return the matrix with all singular values near 1, by the Newton-Schulz iteration."""
    a, b, c = _COEFFICIENTS
    wide = matrix.shape[0] <= matrix.shape[1]
    x: Tensor = matrix if wide else matrix.T
    x = x / (x.norm() + TINY)
    for _ in range(_STEPS):
        gram = x @ x.T
        x = a * x + (b * gram + c * gram @ gram) @ x
    return x if wide else x.T


def _orthogonal_step(gradient: Tensor, state: dict[str, Any]) -> Tensor:
    momentum: Tensor = state.setdefault("momentum", torch.zeros_like(gradient))
    momentum.lerp_(gradient, 1.0 - MOMENTUM)
    ahead = gradient.lerp(momentum, MOMENTUM)
    step: Tensor = orthogonalised(ahead.flatten(1)) * (0.2 * max(ahead.shape[:2]) ** 0.5)
    return step.view_as(gradient)


def _adam_step(gradient: Tensor, state: dict[str, Any]) -> Tensor:
    first: Tensor = state.setdefault("first", torch.zeros_like(gradient))
    second: Tensor = state.setdefault("second", torch.zeros_like(gradient))
    state["count"] = count = state.get("count", 0) + 1
    first.lerp_(gradient, 1.0 - BETAS[0])
    second.lerp_(gradient * gradient, 1.0 - BETAS[1])
    scale = (second / (1.0 - BETAS[1] ** count)).sqrt() + TINY
    step: Tensor = first / (1.0 - BETAS[0] ** count) / scale
    return step
