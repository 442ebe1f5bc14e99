"""Counted multiply-adds of a network equal those computed by hand from its layers."""

import shutil
from dataclasses import asdict
from pathlib import Path

import pytest

from supersampler import ArgumentError
from supersampler.methods.model_file import find_model
from supersampler_bench.timing.cost import CostRecord, cost_of
from supersampler_model.methods.classifier import SmallClassifier


def by_hand() -> float:
    """Multiply-adds a display pixel, of sizes that all levels divide."""
    config = SmallClassifier().config
    network, packed = config.network, 4 * config.planes
    channels, total, seen = packed + config.half_inputs, 0.0, 0.0
    for level, width in enumerate(network.levels):
        total += (channels * width + 9 * width + width * width) / 4**level
        kept = width if level == 3 else width // 2
        seen, channels = seen + kept / 4**level, width // 2
    total += seen * network.decoder + (network.decoder_layers - 1) * network.decoder**2
    total += network.decoder * 6
    total += (packed + network.decoder) * network.hidden
    return (total + network.hidden * 4 * (config.candidates + sum(config.filters))) / 4.0


def test_the_count_is_that_of_the_layers_and_within_the_budget(tmp_path: Path) -> None:
    cost = cost_of(str(shutil.copytree(find_model("classifier-small"), tmp_path / "small")))
    assert cost.multiply_adds == pytest.approx(by_hand())
    assert cost.multiply_adds <= 2000.0
    assert cost.method == "small"
    assert f"{cost.multiply_adds:,.0f}" in CostRecord([cost]).table()


def test_a_method_without_a_network_is_named() -> None:
    with pytest.raises(ArgumentError, match="taau"):
        cost_of("taau")


def test_the_config_of_a_small_one_says_so() -> None:
    assert asdict(SmallClassifier().config)["network"]["hidden"] == 26
