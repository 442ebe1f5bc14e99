"""Kernels draw frames that were not shaded as the graph and torch do, whatever the number of threads."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from extrapolated_noise import SIZES, extrapolated, spoilt_frames, surfaces
from noise import Size
from supersampler import Frame
from supersampler.arguments import ExecutorName
from supersampler.extrapolation import Extrapolator
from supersampler.frame import Float32
from supersampler.methods.extrapolation.spec import GUIDED_WARP


def made(executor: ExecutorName, threads: int = 2) -> Extrapolator:
    return Extrapolator("guided-warp", ["CPUExecutionProvider"], threads, executor)


Backends = tuple[Extrapolator, Extrapolator]


@pytest.fixture(scope="module")
def backends() -> Backends:
    """The ONNX backend and the CPU backend, which a CPU takes unless told not to."""
    onnx, cpu = made("onnx"), made("auto")
    assert (onnx.executor, cpu.executor) == ("onnx", "cpu")
    return onnx, cpu


def check_alike(ones: list[Float32], others: list[Float32]) -> None:
    """A sample may be chosen otherwise where two weigh as much, by the last bit of a sum."""
    for one, other in zip(ones, others, strict=True):
        off = np.abs(one - other) / (1.0 + np.abs(one))
        assert np.isfinite(other).all()
        assert other.min() >= 0.0
        assert np.quantile(off, 0.99) <= 1e-4
        assert off.mean() <= 1e-3


def check_both(backends: Backends, frames: list[Frame], pattern: str) -> list[Float32]:
    """Return the images of the CPU backend, once they are like those of the other."""
    ones, others = (extrapolated(backend, frames, pattern) for backend in backends)
    check_alike(ones, others)
    return others


@pytest.mark.parametrize("sizes", [*((size,) * 7 for size in SIZES), (*SIZES, SIZES[0])])
def test_kernels_compute_as_the_graph(backends: Backends, sizes: Sequence[Size]) -> None:
    frames = [surfaces(seed, size) for seed, size in enumerate(sizes)]
    check_both(backends, frames, "suuusuu")


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, -1.0, 1e30, 1e-42])
@pytest.mark.parametrize("shaded", [True, False])
def test_hostile_pixels_do_the_same_on_both(backends: Backends, bad: float, *, shaded: bool) -> None:
    check_both(backends, spoilt_frames(bad, shaded=shaded), "suuu")


def test_without_depth_samples_are_told_apart_by_other_features(backends: Backends) -> None:
    frames = [surfaces(seed) for seed in range(3)]
    assert frames[0].gbuffer is not None
    lit = frames[0].gbuffer["base_color"] + np.float32(GUIDED_WARP.config().least)  # light of one everywhere
    lit[:, :16] *= 3.0 * frames[0].gbuffer["base_color"][:, :16]  # or of the surface itself
    frames[0] = replace(frames[0], color=lit, depth=np.full((18, 32), np.nan, np.float32))
    images = check_both(backends, frames, "suu")
    known = replace(frames[0], depth=np.ones((18, 32), np.float32))
    flat = [known, *(replace(frame, depth=known.depth) for frame in frames[1:])]
    check_alike(extrapolated(backends[1], flat, "suu"), images)


def test_depths_of_invalid_samples_are_none(backends: Backends) -> None:
    frames = [surfaces(seed) for seed in range(3)]
    normal = np.full((18, 32, 3), np.nan, np.float32)
    frames[0] = replace(frames[0], gbuffer={**(frames[0].gbuffer or {}), "normal": normal})
    check_both(backends, frames, "suu")


def test_the_number_of_threads_changes_no_bit() -> None:
    frames = [surfaces(seed, (97, 55)) for seed in range(5)]
    one, two, five = (extrapolated(made("auto", threads), frames, "suusu") for threads in (1, 2, 5))
    np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(one, five)


def test_a_history_goes_from_the_cpu_backend_to_the_onnx_backend_and_back(backends: Backends) -> None:
    frames = [surfaces(seed) for seed in range(4)]
    for one, other in (backends, backends[::-1]):
        _, history = one.extrapolate(replace(frames[1], color=None), one.after_shaded(frames[0]))
        last, loaded = replace(frames[2], color=None), other.load(one.save(history))
        check_alike([one.extrapolate(last, history)[0]], [other.extrapolate(last, loaded)[0]])


def test_frames_are_read_whatever_they_lie_in_memory(backends: Backends) -> None:
    first, frame, kernels = surfaces(0), replace(surfaces(1), color=None), backends[1]
    fields: dict[str, Any] = {name: np.asfortranarray(getattr(frame, name)) for name in ("depth", "motion")}
    fields["gbuffer"] = {name: np.asfortranarray(image) for name, image in (frame.gbuffer or {}).items()}
    history = kernels.after_shaded(first)
    image, other = (kernels.extrapolate(each, history)[0] for each in (frame, replace(frame, **fields)))
    np.testing.assert_array_equal(image, other)
