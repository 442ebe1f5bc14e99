"""The learned part in half precision, for providers whose processors multiply halves faster."""

import copy

from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from supersampler_model.methods.base import Method


class InHalf(nn.Module):
    """A network that computes in half precision between borders in single precision.

    Batch normalisation is folded into the convolution before it while both are in single precision: means and
    variances need not fit the range of halves, products do.

    Args:
        network: of (tensor, ...) to (tensor, ...); not changed.
    """

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = folded(copy.deepcopy(network).eval()).half()

    def forward(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        """As the network's."""
        return tuple(output.float() for output in self.network(*(value.half() for value in inputs)))


def folded(network: nn.Module) -> nn.Module:
    """Fold each batch normalisation into the convolution that it follows in a `Sequential`; in place."""
    for module in network.modules():
        if not isinstance(module, nn.Sequential):
            continue
        for i, (first, second) in enumerate(zip(list(module)[:-1], list(module)[1:], strict=True)):
            if isinstance(first, nn.Conv2d) and isinstance(second, nn.BatchNorm2d):
                module[i], module[i + 1] = fuse_conv_bn_eval(first, second), nn.Identity()
    return network


def in_half(method: Method) -> Method | None:
    """Return `method` with its learned part in half precision; None where nothing in it is learned."""
    if method.fused() is None:
        return None
    made = copy.deepcopy(method)
    made.net = InHalf(method.get_submodule("net"))
    return made.eval()
