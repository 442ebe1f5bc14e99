"""Quantized layers match float layers to within half a step of each value."""

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import nn

from supersampler.methods.classifier.spec import DEFAULT_INPUTS
from supersampler_export.half import HalfNetwork, folded
from supersampler_export.quantize import (
    BLOCK,
    BYTE,
    EIGHT,
    KEPT,
    MIDDLE,
    SIGNED,
    WORD,
    ByteLayout,
    by_output,
    depthwise,
    packed_bytes,
    pixelwise,
    unpacked,
)
from supersampler_export.quantize import folded as folded_pointwise
from supersampler_model.methods.classifier_network import Pointwise

RANDOM = np.random.default_rng(0)
GIVEN = (
    ByteLayout.of(6, 0.01)
    .beside(ByteLayout.of(3, 0.02, 128.0))
    .followed_by(1)
    .beside(ByteLayout.of(2, 0.005))
)
"""Bytes of eleven channels from three sources, with one of no channel between them."""


def values_of(bytes_: NDArray[np.uint8], layout: ByteLayout) -> NDArray[np.float64]:
    """Values by channel, (channels, n), of bytes (bytes, n)."""
    at = [int(np.flatnonzero(layout.channel == c)[0]) for c in range(layout.channel.max() + 1)]
    return np.asarray((bytes_[at] - layout.zero[at, None]) * layout.scale[at, None])


def test_channels_of_two_sources_lie_one_after_the_other() -> None:
    assert GIVEN.channel.tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 8, -1, 9, 10]
    assert GIVEN.scale.tolist() == [0.01] * 6 + [0.02] * 3 + [1.0] + [0.005] * 2
    assert GIVEN.zero.tolist() == [0.0] * 6 + [128.0] * 3 + [0.0] * 3


@pytest.mark.parametrize(("length", "multiple", "room"), [(12, 4, 0), (13, 4, 3), (1, 32, 31)])
def test_room_fills_up_to_a_multiple(length: int, multiple: int, room: int) -> None:
    made = ByteLayout.of(length, 0.5, 3.0).up_to(multiple)
    assert len(made.channel) == length + room
    assert (made.channel[length:] == -1).all()
    assert (made.channel[:length] >= 0).all()


@pytest.mark.parametrize("order", [list(range(8)), [3, 1, -1, 0, 2, 7, 6, 5, 4]])
def test_a_1x1_convolution_of_bytes_is_that_of_floats(order: list[int]) -> None:
    weights, bias = RANDOM.normal(size=(8, 11)), RANDOM.normal(size=8)
    made = ByteLayout.of(order, 0.02, MIDDLE)
    layer = pixelwise(weights, bias, GIVEN, made)
    assert layer["weights"].dtype == np.int8
    assert layer["weights"].shape == (1, 12 // WORD, BLOCK, WORD)
    given = RANDOM.integers(0, 256, (12, 50)).astype(np.uint8)
    flat = layer["weights"].transpose(0, 2, 1, 3).reshape(BLOCK, 12).astype(np.int64)
    there = [place for place, channel in enumerate(order) if channel >= 0]
    assert (np.abs(flat[there]).max(axis=1) == SIGNED).all(), "the range is used"
    got = (flat @ given) * layer["scale"][:, None] + layer["bias"][:, None]
    want = weights @ values_of(given, GIVEN) + bias[:, None]
    for place, channel in enumerate(order):
        if channel < 0:
            assert not got[place].any()
            continue
        step = np.abs(weights[channel] * np.append(GIVEN.scale[:9], GIVEN.scale[10:])).max() / SIGNED
        off = np.abs((got[place] - MIDDLE) * 0.02 - want[channel])
        assert off.max() <= 0.5 * step * 255 * 11
        assert off.mean() <= 0.5 * step * 255 * 11**0.5
    assert not got[len(order) :].any()


def test_the_last_layer_lies_output_by_output() -> None:
    layer = pixelwise(
        RANDOM.normal(size=(11, 8)), RANDOM.normal(size=11), ByteLayout.of(8, 0.1), ByteLayout.of(11, 1.0)
    )
    turned = by_output(layer, 11)
    assert turned["weights"].shape == (2 * EIGHT, 8 // WORD, WORD)
    assert turned["scale"].shape == turned["bias"].shape == (2 * EIGHT,)
    for output in range(11):
        np.testing.assert_array_equal(turned["weights"][output], layer["weights"][0, :, output])


def test_a_3x3_convolution_of_each_channel_of_bytes_is_that_of_floats() -> None:
    weights = RANDOM.normal(size=(32, 3, 3))
    layer = depthwise(weights, 0.02, 0.05)
    assert layer["weights"].shape == (2, 3, 16, WORD)
    assert (layer["bias"] == MIDDLE).all()
    around = RANDOM.integers(0, 256, (32, 3, 3))
    columns = layer["weights"].transpose(0, 2, 3, 1).reshape(32, WORD, 3)  # (channel, row, column)
    assert not columns[:, 3].any()
    got = (columns[:, :3].astype(int) * around).sum(axis=(1, 2)) * layer["scale"]
    want = (weights * around).sum(axis=(1, 2)) * 0.02 / 0.05
    np.testing.assert_allclose(got, want, atol=9 * 255 * 0.5 * np.abs(weights).max() / SIGNED * 0.4)
    assert np.corrcoef(got, want)[0, 1] > 0.999


def test_batch_normalisation_is_within_the_weights() -> None:
    torch.manual_seed(0)
    layer = Pointwise(5, 7, rectified=False).eval()
    for name, value in layer.named_buffers():
        if "running" in name:
            value.copy_(0.5 + torch.rand(7))
    torch.nn.init.normal_(layer.get_parameter("1.weight"))
    torch.nn.init.normal_(layer.get_parameter("1.bias"))
    weights, bias = folded_pointwise(layer)
    given = torch.randn(1, 5, 1, 4)
    want = layer(given)[0, :, 0].detach().numpy()
    np.testing.assert_allclose(weights @ given[0, :, 0].numpy() + bias[:, None], want, rtol=1e-4, atol=1e-5)


def test_packed_pixels_are_from_0_to_1_but_for_the_difference_of_depth() -> None:
    packed, at = packed_bytes(), DEFAULT_INPUTS.index("depth_difference")
    values = np.stack([(b - packed.zero) * packed.scale for b in (0.0, BYTE)])
    assert len(packed.channel) == 4 * len(DEFAULT_INPUTS)
    np.testing.assert_allclose(values[1], 1.0)
    low = np.zeros(4 * len(DEFAULT_INPUTS))
    low[4 * at : 4 * at + 4] = -1.0
    np.testing.assert_allclose(values[0], low)


@pytest.mark.parametrize("level", range(len(KEPT)))
def test_every_channel_of_a_level_is_read_once_in_its_bytes(level: int) -> None:
    parts = 4**level
    channels = parts * max(KEPT[level] // 2, 1)
    order = unpacked(channels, level)
    assert len(order) == parts * KEPT[level]
    assert sorted(c for c in order if c >= 0) == list(range(channels))
    for part in range(parts):
        own = order[part * KEPT[level] : (part + 1) * KEPT[level]]
        assert all(c % parts == part for c in own if c >= 0)


def test_a_network_in_halves_has_its_normalisation_folded_and_says_nearly_the_same() -> None:
    torch.manual_seed(0)
    network = nn.Sequential(
        Pointwise(3, 4), nn.Conv2d(4, 4, 3, padding=1), Pointwise(4, 2, rectified=False)
    ).eval()
    for name, value in network.named_buffers():
        if "running" in name:
            value.copy_(0.5 + torch.rand(value.shape))
    given = torch.rand(1, 3, 6, 5)
    want = network(given)

    class Tupled(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.inner = network

        def forward(self, image: torch.Tensor) -> tuple[torch.Tensor]:
            return (self.inner(image),)

    half = HalfNetwork(Tupled())
    (got,) = half(given)
    assert got.dtype == torch.float32
    torch.testing.assert_close(got, want, rtol=2e-2, atol=2e-2)
    kinds = [type(module) for module in half.modules()]
    assert nn.BatchNorm2d not in kinds
    assert {p.dtype for p in half.parameters()} == {torch.float16}
    assert {p.dtype for p in network.parameters()} == {torch.float32}, "the one given stays as it is"
    torch.testing.assert_close(folded(network)(given), want, rtol=1e-4, atol=1e-5)
