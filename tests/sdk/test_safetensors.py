"""Tests that arrays in `.safetensors` files are read as they were written."""

from pathlib import Path

import numpy as np
import pytest

from supersampler import ShotError
from supersampler.io.safetensors import open_safetensors, write_safetensors

TYPES = ("f2", "f4", "f8", "?", "u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8")


def test_arrays_of_every_type_and_layout_come_back_aligned(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    arrays = {kind: random.integers(0, 2, (3, 5, 7)).astype(kind)[:, ::2] for kind in TYPES}
    arrays |= {"empty": np.zeros((0, 3), np.float32), "scalar": np.array(np.nan, np.float32)}
    write_safetensors(tmp_path / "a.safetensors", arrays)
    found, _ = open_safetensors(tmp_path / "a.safetensors")
    assert found.keys() == arrays.keys()
    for name, array in arrays.items():
        assert (found[name].dtype, found[name].shape) == (array.dtype, array.shape)
        assert found[name].tobytes() == array.tobytes()
        assert found[name].flags.aligned


def test_an_array_that_the_format_cannot_hold_is_refused_and_no_file_is_left(tmp_path: Path) -> None:
    with pytest.raises(ShotError, match="cannot hold a, of type object"):
        write_safetensors(tmp_path / "a.safetensors", {"a": np.array([None])})
    assert not any(tmp_path.iterdir())
