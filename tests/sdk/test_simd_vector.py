"""Vectors for kernels: what LLVM makes of them is what is written."""

import ctypes
from collections.abc import Callable, Collection
from typing import Any

import numpy as np
import pytest
from numba import cfunc, types

from supersampler.backends.cpu.kernels.colors import logarithm
from supersampler.backends.cpu.memory import address
from supersampler.backends.cpu.simd import vector
from supersampler.backends.cpu.simd.shuffles import load_columns, load_columns4, load_columns8
from supersampler.backends.cpu.simd.vector import dot4, gather_nearby, load16, store
from supersampler.methods.classifier.kernels.compose import factor

FLOATS, WORDS = types.CPointer(types.float32), types.CPointer(types.int32)


FEATURES = ((), ("avx2",), ("avx2", "avxvnni"), ("avx2", "avx512f", "avx512vnni"))
"""Processors that get other code; those whose instructions this one lacks are left out."""


def have_only(monkeypatch: pytest.MonkeyPatch, features: Collection[str]) -> None:
    if not all(vector.has(feature) for feature in features):
        pytest.skip("this processor has it not")
    monkeypatch.setattr(vector, "has", lambda feature: feature in features)


def run(function: Callable[..., None], kinds: list[Any], *arrays: Any) -> None:
    """Compile and call."""
    made = cfunc(types.void(*kinds), error_model="numpy")(function)
    ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * len(arrays))(made.address)(*(address(a) for a in arrays))


def test_a_factor_is_its_exponential_to_a_hundred_thousandth() -> None:
    def all_of(given: Any, made: Any) -> None:
        for i in range(0, 4096, 16):
            store(made, i, factor(load16(given, i)))

    given, made = np.linspace(-20.0, 20.0, 4096).astype(np.float32), np.zeros(4096, np.float32)
    run(all_of, [FLOATS, FLOATS], given, made)
    np.testing.assert_allclose(made, np.exp(np.clip(given, -16.0, 16.0).astype(float)), rtol=1e-5)


def test_the_logarithm_is_exact_to_single_precision() -> None:
    def all_of(given: Any, made: Any) -> None:
        for i in range(0, 4096, 16):
            store(made, i, logarithm(load16(given, i)))

    given, made = np.geomspace(1e-30, 1e30, 4096).astype(np.float32), np.zeros(4096, np.float32)
    run(all_of, [FLOATS, FLOATS], given, made)
    np.testing.assert_allclose(made, np.log(given.astype(float)), rtol=3e-7, atol=3e-7)


@pytest.mark.parametrize("features", FEATURES)
def test_four_bytes_are_multiplied_and_added_exactly(
    features: Collection[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    have_only(monkeypatch, features)

    def all_of(total: Any, unsigned: Any, signed: Any, made: Any) -> None:
        store(made, 0, dot4(load16(total, 0), load16(unsigned, 0), load16(signed, 0)))

    random = np.random.default_rng(1)
    unsigned, signed = (
        random.choice([0, 1, 127, 128, 254, 255], 64),
        random.choice([-128, -127, -1, 0, 127], 64),
    )
    total, made = random.integers(-1000, 1000, 16).astype(np.int32), np.zeros(16, np.int32)
    run(all_of, [WORDS] * 4, total, unsigned.astype(np.uint8), signed.astype(np.int8), made)
    np.testing.assert_array_equal(made, total + (unsigned * signed).reshape(16, 4).sum(axis=1))


@pytest.mark.parametrize("features", FEATURES)
def test_lanes_go_where_an_index_says(features: Collection[str], monkeypatch: pytest.MonkeyPatch) -> None:
    have_only(monkeypatch, features)

    def all_of(given: Any, index: Any, made: Any) -> None:
        store(made, 0, gather_nearby(given, 3, 5, load16(index, 0)))

    random = np.random.default_rng(2)
    given, made = random.random(32, np.float32), np.zeros(16, np.float32)
    index = random.integers(0, 8, 16).astype(np.int32)
    run(all_of, [FLOATS, WORDS, FLOATS], given, index, made)
    np.testing.assert_array_equal(made, given[3 + index + np.repeat([0, 5], 8)])


@pytest.mark.parametrize(("load", "channels"), [(load_columns, 16), (load_columns8, 8), (load_columns4, 4)])
def test_pixels_become_channels(load: Any, channels: int) -> None:
    def all_of(given: Any, made: Any) -> None:
        i = 0
        for column in load(given, 0):
            store(made, i, column)
            i += 16

    given, made = np.arange(16 * channels, dtype=np.float32), np.zeros((channels, 16), np.float32)
    run(all_of, [FLOATS, FLOATS], given, made)
    np.testing.assert_array_equal(made, given.reshape(16, channels).T)
