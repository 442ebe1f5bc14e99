"""Conversion of a method to half precision, which some providers move and compute faster."""

import copy
from typing import TypeVar

from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from supersampler_model.methods.base import LearnedMethod, Method

Folded = TypeVar("Folded", bound=nn.Module)


class HalfNetwork(nn.Module):
    """A network in half precision with float32 inputs and outputs.

    `network`, which is not changed, returns a tuple of tensors. Batch normalisation is folded into the
    preceding convolution in float32, as its means and variances may exceed the range of half floats.
    """

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = folded(copy.deepcopy(network).eval()).half()

    def forward(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        """Run the network."""
        return tuple(output.float() for output in self.network(*(value.half() for value in inputs)))


def folded(network: Folded) -> Folded:
    """Fold each batch normalisation into the convolution before it in a `Sequential`; in place."""
    for module in network.modules():
        if not isinstance(module, nn.Sequential):
            continue
        for i, (first, second) in enumerate(zip(list(module)[:-1], list(module)[1:], strict=True)):
            if isinstance(first, nn.Conv2d) and isinstance(second, nn.BatchNorm2d):
                module[i], module[i + 1] = fuse_conv_bn_eval(first, second), nn.Identity()
    return network


def to_half(method: Method) -> Method | None:
    """Return `method` in half precision; None without a network.

    With `runs_in_fp16` all stages compute in half floats (docs/explanation/precision.md), otherwise only the
    network.
    """
    if method.subgraph() is None or not isinstance(method, LearnedMethod):
        return None
    made = copy.deepcopy(method).eval()
    made.net = folded(made.net).half() if method.runs_in_fp16 else HalfNetwork(made.net)
    return made.eval()
