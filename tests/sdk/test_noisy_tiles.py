"""skip="accumulate": noise averages out without end, and every other change is noticed."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from supersampler import ArgumentError, Frame, Model, Upscaler, halton_jitter
from supersampler.backends.cpu.kernel_loader import load_kernels
from supersampler.backends.cpu.layout import SUM_VALUES
from supersampler.backends.cpu.memory import address, aligned
from supersampler.backends.cpu.noisy_tile_reuse import NOISY_TILE_KERNELS
from supersampler.backends.cpu.noisy_tiles import NoisyTiles
from supersampler.backends.cpu.static_weights import StaticWeights
from supersampler.backends.cpu.structs import AddedSamples, AxisSamples, pack
from supersampler.cli.arguments import parse_skip
from supersampler.conventions import jitter_phase_count
from supersampler.frame import Float32, Size

DISPLAY: Size = (64, 32)
NOISE = 0.25
"""Standard deviation of a sample, as a part of the light."""
SHOWN = jitter_phase_count(2.0) + 1
"""Frames after the first until tiles begin to fade at ratio 2."""


@pytest.fixture(scope="module")
def model() -> Model:
    return Model.load("taau", executor="cpu", threads=2)


def light(x: NDArray[np.floating], y: NDArray[np.floating]) -> NDArray[np.floating]:
    """Smooth, so that a pixel's mean is the light at its centre."""
    shade: NDArray[np.floating] = 0.5 + 0.2 * np.sin(x / 9.0) * np.cos(y / 7.0)
    return shade


def truth() -> Float32:
    x, y = np.arange(DISPLAY[0]) + 0.5, np.arange(DISPLAY[1])[:, None] + 0.5
    return np.repeat(light(x, y)[..., None], 3, axis=2).astype(np.float32)


class Scene:
    """Frames of a scene that stands still, under noise of some seed."""

    def __init__(self, ratio: float = 2.0, samples: int = 4, kind: str = "gaussian", seed: int = 0) -> None:
        self.ratio, self._samples, self._kind = ratio, samples, kind
        self._rng = np.random.default_rng(seed)

    def frame(self, index: int, *, jitter: tuple[float, float] | None = None, **fields: object) -> Frame:
        w, h = (int(extent / self.ratio) for extent in DISPLAY)
        place = halton_jitter(index, self.ratio) if jitter is None else jitter
        x, y = (np.arange(w) + 0.5 + place[0]) * self.ratio, (np.arange(h) + 0.5 + place[1]) * self.ratio
        color = np.repeat(light(x, y[:, None])[..., None], 3, axis=2)
        if self._kind == "poisson":  # of the same deviation
            rate = self._samples / NOISE**2
            color *= self._rng.poisson(rate, (h, w, 1)) / rate
        else:
            color *= self._rng.normal(1.0, NOISE / self._samples**0.5, (h, w, 1))
        return Frame(
            color=color.astype(np.float32),
            depth=np.full((h, w), 0.1, np.float32),
            motion=np.zeros((h, w, 2), np.float32),
            jitter=place,
            exposure=1.0,
            **fields,  # type: ignore[arg-type]
        )


def made(model: Model) -> Upscaler:
    return Upscaler(model, display_size=DISPLAY, validate="off", skip="accumulate")


def noise_of(upscaler: Upscaler) -> NoisyTiles:
    history = upscaler._memory.history
    assert history is not None
    noise = history.buffers.tile_state.noise
    assert isinstance(noise, NoisyTiles)
    return noise


def accumulated(model: Model, frames: int = 2 * SHOWN) -> tuple[Upscaler, Scene]:
    upscaler, scene = made(model), Scene()
    for index in range(frames):
        upscaler.step(scene.frame(index))
    assert (noise_of(upscaler).counts == frames - 1).all()
    return upscaler, scene


@pytest.mark.parametrize("ratio", [1.0, 2.0])
@pytest.mark.parametrize(("kind", "samples"), [("gaussian", 1), ("gaussian", 16), ("poisson", 4)])
def test_the_error_falls_with_the_square_root_of_the_frames(
    model: Model, ratio: float, kind: str, samples: int
) -> None:
    upscaler, scene = made(model), Scene(ratio, samples, kind)
    for index in range(513):
        image = upscaler.step(scene.frame(index))
    counts = noise_of(upscaler).counts
    assert counts.min() == 512
    expected = NOISE / np.sqrt(samples) / np.sqrt(512 / ratio**2)
    error = np.sqrt(np.mean((image / truth() - 1.0) ** 2))
    assert error < 1.25 * expected
    assert upscaler.stats.work < 2 * jitter_phase_count(ratio)


def test_nothing_pops_while_the_image_fades_to_the_mean(model: Model) -> None:
    upscaler, scene = made(model), Scene(samples=16)
    images = np.stack([upscaler.step(scene.frame(index)).copy() for index in range(4 * SHOWN)])
    steps = np.abs(np.diff(images, axis=0)).mean((1, 2, 3))
    assert steps[SHOWN:].max() < steps[SHOWN // 2 : SHOWN].max()
    assert steps[-1] < 0.2 * steps[SHOWN // 2]


def test_a_lamp_is_seen_at_once_and_restarts_only_the_tiles_that_it_lights(model: Model) -> None:
    upscaler, scene = accumulated(model)
    before = noise_of(upscaler).counts.copy()
    for k in range(2):
        frame = scene.frame(2 * SHOWN + k)
        color = np.array(frame.color)
        color[:, :16] *= 3.0
        work = upscaler.stats.work
        image = upscaler.step(replace(frame, color=color))
        assert upscaler.stats.work > work
    counts = noise_of(upscaler).counts
    assert (counts[:, :4] == 1.0).all()
    assert (counts[:, 5:] == before[:, 5:] + 2.0).all()
    assert image[:, :28].mean() > 1.5 * truth()[:, :28].mean()


def test_a_light_that_fades_slowly_restarts_before_it_is_ten_percent_off(model: Model) -> None:
    upscaler, scene = accumulated(model)
    for k in range(200):
        frame = scene.frame(2 * SHOWN + k)
        upscaler.step(replace(frame, color=np.asarray(frame.color) * np.float32(1.0 - k / 1000.0)))
    assert (noise_of(upscaler).counts < 200).all()


def test_one_firefly_and_one_nan_cost_no_samples(model: Model) -> None:
    for value in (900.0, np.nan, np.inf, -1.0):
        upscaler, scene = accumulated(model)
        before = noise_of(upscaler).counts.copy()
        frame = scene.frame(2 * SHOWN)
        color = np.array(frame.color)
        color[5, 7] = value
        assert np.isfinite(upscaler.step(replace(frame, color=color))).all()
        for k in range(3):
            image = upscaler.step(scene.frame(2 * SHOWN + 1 + k))
        assert (noise_of(upscaler).counts == before + 4.0).all()
        assert np.isfinite(image).all()


def test_motion_and_depth_restart_the_tiles_in_which_they_change(model: Model) -> None:
    for field in ("motion", "depth"):
        upscaler, scene = accumulated(model)
        for k in range(2):
            frame = scene.frame(2 * SHOWN + k)
            depth, motion = np.array(frame.depth), np.array(frame.motion)
            (motion if field == "motion" else depth)[4:8, 4:8] += 0.25
            upscaler.step(replace(frame, depth=depth, motion=motion))
        counts = noise_of(upscaler).counts
        assert counts[1, 1] <= 1.0
        assert (counts[:, 3:] == 2 * SHOWN + 1).all()


@pytest.mark.parametrize("change", ["reset", "size", "aovs"])
def test_a_reset_another_size_and_aovs_begin_anew(model: Model, change: str) -> None:
    upscaler, scene = accumulated(model)
    if change == "size":
        scene.ratio = 1.6
    frame = scene.frame(2 * SHOWN)
    if change == "reset":
        frame = replace(frame, reset=True)
    if change == "aovs":
        upscaler.step(replace(frame, aovs=np.ones((*frame.depth.shape, 1), np.float32)), outputs=("aovs",))
    upscaler.step(frame)
    for k in range(3):
        upscaler.step(scene.frame(2 * SHOWN + 1 + k))
    assert (noise_of(upscaler).counts <= 4.0).all()


def test_jitter_that_never_repeats_or_is_zero_accumulates_too(model: Model) -> None:
    rng = np.random.default_rng(2)
    for most in (0.5, 0.0):
        upscaler, scene = made(model), Scene(samples=16)
        for index in range(300):
            x, y = (float(v) for v in rng.uniform(-most, most, 2))
            image = upscaler.step(scene.frame(index, jitter=(x, y)))
        assert (noise_of(upscaler).counts == 299).all()
        assert np.sqrt(np.mean((image / truth() - 1.0) ** 2)) < (0.03 if most else 0.1)


def test_a_state_continues_bit_for_bit(model: Model) -> None:
    one, scene = accumulated(model, SHOWN + 5)
    other = made(model)
    other.load_state(one.save_state())
    for k in range(SHOWN + 5, SHOWN + 25):
        frame = scene.frame(k)
        assert np.array_equal(one.step(frame), other.step(frame))
        assert one.stats.converged == other.stats.converged


def test_thousands_of_samples_lose_nothing_to_rounding() -> None:
    count, value = 20_000, np.float32(0.1)
    weights = StaticWeights((8, 8), (8, 8), [(0.0, 0.0)])
    rows, columns = (AxisSamples(axis.sample[0], axis.kind) for axis in (weights.rows, weights.columns))
    color, modes, table = aligned((8, 8, 3)), np.full((1, 1), 3, np.uint8), weights.table[0]
    color[:] = value
    sums, compensation = aligned((8, 8, SUM_VALUES)), aligned((8, 8, 4))
    inputs = pack(AddedSamples(modes, sums, sums, color, rows, columns, table, table.shape[1], 8, 8, 8))
    add = load_kernels(NOISY_TILE_KERNELS[1])[NOISY_TILE_KERNELS[1]]
    for _ in range(count):
        add(inputs, address(compensation), 0, 1, 0, 1, address(compensation))
    np.testing.assert_allclose(sums[..., :3], count * np.float64(value), rtol=2e-7)


def test_the_word_is_checked_and_the_command_line_takes_it() -> None:
    assert parse_skip("accumulate") == "accumulate"
    with pytest.raises(ArgumentError, match="Did you mean 'accumulate'"):
        parse_skip("acumulate")
    with pytest.raises(ArgumentError, match="Did you mean 'accumulate'"):
        Upscaler("taa", display_size=DISPLAY, skip="accumulated")  # type: ignore[arg-type]
