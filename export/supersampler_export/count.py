"""Multiply-adds of a network, counted from tensor shapes."""

import copy

import torch
from torch.utils.flop_counter import FlopCounterMode

from supersampler.frame import Size
from supersampler.methods.model_info import extents
from supersampler.methods.spec import sized
from supersampler_model.methods.base import NetworkSubgraph

COUNTED_AT: Size = (960, 544)
"""Display size that is a multiple of the network's coarsest pixels."""


def multiply_adds_of(subgraph: NetworkSubgraph, display_size: Size = COUNTED_AT) -> float:
    """Count the multiply-adds of convolutions and matrix products, per display pixel, on meta tensors.

    Args:
        subgraph: the learned part of a method.
        display_size: (width, height).
    """
    render = (display_size[0] // subgraph.ratio, display_size[1] // subgraph.ratio)
    sizes = extents(render=render, display=display_size, previous=render)
    inputs = [torch.empty(sized(shape, sizes), device="meta") for shape in subgraph.inputs.values()]
    network = copy.deepcopy(subgraph.module).eval().to("meta")
    with torch.no_grad(), FlopCounterMode(display=False) as counter:
        network(*inputs)
    operations: int = counter.get_total_flops()  # a product and a sum per multiply-add
    return operations / 2 / (display_size[0] * display_size[1])
