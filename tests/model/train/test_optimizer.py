"""The optimizer: Muon steps are orthogonal, other weights take Adam steps, and both reduce a loss."""

import pytest
import torch
from torch import nn

from supersampler_model.training.optimizer import Muon, is_matrix, orthogonalised


@pytest.mark.parametrize("shape", [(8, 8), (4, 20), (20, 4)])
def test_singular_values_come_near_one(shape: tuple[int, int]) -> None:
    torch.manual_seed(0)
    values = torch.linalg.svdvals(orthogonalised(torch.randn(shape)))
    assert values.min() > 0.6
    assert values.max() < 1.3


def test_only_weights_of_1x1_convolutions_are_matrices() -> None:
    assert is_matrix(nn.Conv2d(4, 8, 1).weight)
    assert not is_matrix(nn.Conv2d(8, 8, 3, groups=8).weight)
    assert not is_matrix(nn.BatchNorm2d(4).weight)


def test_a_network_learns_a_linear_map() -> None:
    torch.manual_seed(0)
    network = nn.Sequential(nn.Conv2d(6, 6, 1, bias=False), nn.BatchNorm2d(6))
    mixed = nn.Conv2d(6, 6, 1).requires_grad_(False)
    optimizer = Muon(network.parameters(), rate=0.02, decay=0.0)
    losses = []
    for _ in range(60):
        image = torch.randn(2, 6, 8, 8)
        loss = (network(image) - mixed(image)).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert losses[-1] < 0.25 * losses[0]


def test_its_state_goes_on_where_it_was() -> None:
    def run(stop: int | None) -> torch.Tensor:
        torch.manual_seed(0)
        layer = nn.Conv2d(3, 3, 1)
        optimizer = Muon(layer.parameters(), rate=0.02, decay=0.01)
        for index in range(6):
            if index == stop:
                state = optimizer.state_dict()
                optimizer = Muon(layer.parameters(), rate=0.02, decay=0.01)
                optimizer.load_state_dict(state)
            layer(torch.full((1, 3, 2, 2), float(index))).square().mean().backward()
            optimizer.step()
        return layer.weight.detach()

    assert torch.equal(run(None), run(3))
