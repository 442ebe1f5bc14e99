"""The counted work of the stages of `gbuffer` adds up to that of its network."""

from collections.abc import Iterator

import onnx
import pytest
import torch

from studies.stage_breakdown import STAGES, breakdown_record, markdown_table, measure_stages
from supersampler import ArgumentError
from supersampler.methods.model_file import find_model
from supersampler_export.count import multiply_adds


@pytest.fixture(autouse=True)
def threads() -> Iterator[None]:
    """A measurement sets them for its process."""
    count = torch.get_num_threads()
    yield
    torch.set_num_threads(count)


def test_the_stages_are_timed_and_their_work_is_that_of_the_network() -> None:
    found = measure_stages("gbuffer-small-4x", (64, 32), threads=1, steps=1)
    assert list(found.milliseconds) == list(STAGES)
    assert min(found.milliseconds.values()) > 0.0
    network = onnx.load(find_model("gbuffer-small-4x") / "network.onnx")
    counted = multiply_adds(network, (64, 32), ratio=4) * 64 * 32
    assert sum(found.multiply_adds.values()) == pytest.approx(counted)
    table = markdown_table({**breakdown_record([found], 1), "machine": {"cpu": "a", "cores": 1}})
    assert "| gbuffer-small-4x | 64x32 |" in table


def test_other_methods_and_sizes_are_refused() -> None:
    with pytest.raises(ArgumentError, match="gbuffer-small"):
        measure_stages("taau", (64, 32), threads=1, steps=1)
    with pytest.raises(ArgumentError, match="multiples of 4"):
        measure_stages("gbuffer-4x", (66, 32), threads=1, steps=1)
