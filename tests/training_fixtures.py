"""The training set of most tests of training."""

import pytest

from gbuffer_sets import gbuffer_data
from supersampler_model.data.dataset.storage import Dataset


@pytest.fixture(scope="session")
def data(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Return a set with G-buffers of both sizes, at ratios 1 and 2."""
    return gbuffer_data(tmp_path_factory.mktemp("set"))
