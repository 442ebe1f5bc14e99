"""The GPU agrees with torch at rest: decisions, means, images, frozen pixels."""

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from gpu_steps import INT8
from supersampler import Frame, halton_jitter
from supersampler.backends.base import StepRequest
from supersampler.backends.gpu.executor import GpuExecutor
from supersampler.backends.gpu.history import GpuHistory
from supersampler.backends.gpu.memory import read_back, write_to
from supersampler.frame import Float32, Size
from supersampler.io.display import display_transform
from supersampler.methods.at_rest import NOISY
from supersampler.methods.executors import gpu_program
from supersampler.methods.model_file import read_upscaling_info
from supersampler_model.methods import load_method
from torch_inputs import Stepped

RENDER, DISPLAY = (22, 14), (44, 28)
PERIOD = 32
MEAN, LARGEST = 1e-3, 1.0 / 255.0
QUANTILE = 0.999
OWN = {"taau": 9.0, "classifier": 40.0, "classifier-large": 40.0}
"""That quantile of the methods' own images, over LARGEST: networks here are of int8, not in torch."""


class Given(NamedTuple):
    frame: Frame
    adds_samples: float = 1.0


def scene(x: Any, y: Any) -> Float32:
    """Linear RGB at places of a unit square: shades, edges, and a fine pattern."""
    shade = 0.4 + 0.3 * np.sin(9.0 * x + 4.0 * y)
    edge = np.where((x - 0.5) * 0.8 + (y - 0.45) * 1.7 > 0.0, 0.9, 0.2)
    pattern = np.where(np.floor(13.0 * x) % 2 == 0, 1.2, 0.3)
    return np.stack([shade, edge, np.where(y > 0.6, pattern, 0.5 * shade)], -1).astype(np.float32)


def frame_at(
    index: int,
    render: Size = RENDER,
    *,
    period: int = PERIOD,
    ratio: float = 2.0,
    light: Any = 1.0,
    **fields: Any,
) -> Frame:
    """A static scene, sampled with jitter; `light` multiplies its colour, a number or (h, w, 1)."""
    jitter = halton_jitter(index % period, ratio)
    y, x = np.mgrid[: render[1], : render[0]]
    place = (x + 0.5 + jitter[0]) / render[0], (y + 0.5 + jitter[1]) / render[1]
    given: dict[str, Any] = {
        "color": scene(*place) * np.float32(light),
        "depth": np.full(render[::-1], 0.5, np.float32),
        "motion": np.zeros((*render[::-1], 2), np.float32),
        "jitter": jitter,
        "exposure": 1.0,
    }
    return Frame(**{**given, **fields})


@cache
def executor(method: str) -> GpuExecutor:
    program = gpu_program(read_upscaling_info(method))
    assert program is not None
    return GpuExecutor(program)


class OnGpu:
    """Steps of the GPU backend on two sets of buffers, as `Upscaler` takes them."""

    def __init__(self, method: str, display: Size, *, skip: bool = True) -> None:
        self.executor, self.display, self.skip = executor(method), display, skip
        self.history: GpuHistory | None = None
        self.spare: GpuHistory | None = None

    def step(self, given: Given) -> tuple[Float32, Float32 | None]:
        """Return image and `converged`, which is None where the method is skipped."""
        frame, gpu = given.frame, self.executor
        if self.history is None or frame.reset:
            self.history = gpu.zeros(self.display, frame.size)
        if self.spare is None or not gpu.fits(self.spare, self.display, frame.size):
            self.spare = gpu.zeros(self.display, frame.size)
        image = np.empty((*self.display[::-1], 3), np.float32)
        wanted = () if self.skip else ("weight", "converged")
        buffers = self.history, self.spare
        request = StepRequest(frame, self.display, *buffers, image, wanted, given.adds_samples, self.skip)
        [found] = gpu.step_many([request])
        before, self.history, self.spare = self.history, self.spare, None
        self.spare = before if gpu.fits(before, self.display, frame.size) else None
        return image, found.outputs["converged"][0, 0] if wanted else None

    def tensor(self, name: str) -> Float32:
        assert self.history is not None
        return self.executor.tensor(self.history, name)


def shown(image: Float32, exposure: float | None = None) -> Float32:
    return display_transform(image, exposure or 1.0)


module = cache(load_method)


def compare_steps(
    sequence: Sequence[Given],
    display: Size = DISPLAY,
    *,
    method: str = "taau",
    skip: bool = False,
    largest: float = LARGEST,
    decisions: float = 1.0,
    strict: bool = False,
) -> tuple[OnGpu, list[float]]:
    """Step both through a sequence and compare what each step gives; return frozen parts of the image.

    `decisions` is the least part of blocks that are decided alike in each frame. Frozen pixels differ by at
    most `largest`. The images of `taau` itself, which reads samples as half floats, may differ more in
    single pixels: in a `strict` sequence in one of a thousand.
    """
    ours, theirs = OnGpu(method, display, skip=skip), Stepped(module(method), display)
    frozen = []
    for index, given in enumerate(sequence):
        theirs.adds_samples = given.adds_samples
        (image, converged), wanted = ours.step(given), theirs.step(given.frame)
        stands = theirs.frozen
        text = f"frame {index}"
        found, known = ours.tensor("static_blocks"), theirs.tensor("static_blocks")
        same = (found[:, 0] == known[:, 0]).mean()
        assert same >= decisions, f"{text}: {found[0, 0]} {known[0, 0]}"
        np.testing.assert_array_equal(ours.tensor("phases"), theirs.tensor("phases"), text)
        if converged is not None and decisions == 1.0:
            np.testing.assert_array_equal(converged, stands, text)
        if decisions == 1.0:
            np.testing.assert_allclose(found[:, 1:], known[:, 1:], rtol=1e-3, atol=2e-3, err_msg=text)
            ours_mean, mean = ours.tensor("static_mean")[0], theirs.tensor("static_mean")[0]
            np.testing.assert_allclose(ours_mean[3], mean[3], rtol=1e-4, atol=1e-4, err_msg=text)
            off = np.abs(shown_planes(ours_mean) - shown_planes(mean)) * (mean[3] > 1e-3)
            assert off.max() <= largest, text
        off = np.abs(shown(image) - shown(wanted))
        assert off.mean() <= (MEAN if method == "taau" else INT8), text
        assert off.max(initial=0.0, where=(stands > 0.0)[..., None]) <= largest, text
        assert np.quantile(off, QUANTILE) <= largest * (1.0 if strict else OWN[method]), text
        frozen.append(float(stands.mean()))
    return ours, frozen


def shown_planes(mean: Float32) -> Float32:
    return shown(np.ascontiguousarray(mean[:3].transpose(1, 2, 0))).transpose(2, 0, 1)


def still(frames: int, *args: Any, **options: Any) -> list[Given]:
    return [Given(frame_at(index, *args, **options)) for index in range(frames)]


def test_a_still_scene_freezes_as_in_torch_borders_included() -> None:
    _, frozen = compare_steps(still(2 * PERIOD + 8), strict=True)
    assert frozen[2 * PERIOD - 2] == 0.0
    assert frozen[-1] > 0.8


@pytest.mark.parametrize("method", ["taau", "classifier", "classifier-large"])
def test_moving_pixels_are_not_averaged_and_restart_the_covered_ones(method: str) -> None:
    _, frozen = compare_steps(list(movers()), method=method, decisions=0.95)
    assert frozen[2 * PERIOD + 9] > 0.3
    assert frozen[2 * PERIOD + 20] < frozen[2 * PERIOD + 9]


def uniform(frames: int, **options: Any) -> list[Given]:
    """Frames of plain light, which freeze everywhere."""
    color = np.full((*RENDER[::-1], 3), 0.5, np.float32)
    return [Given(frame_at(index, color=color, **options)) for index in range(frames)]


@pytest.mark.parametrize("method", ["taau", "classifier", "classifier-large"])
def test_a_frame_that_is_frozen_everywhere_keeps_all_of_its_history(method: str) -> None:
    sequence = uniform(2 * PERIOD + 6)
    ours, frozen = compare_steps(sequence, method=method)
    assert frozen[-1] == 1.0
    counted = "phases", "signatures", "static_blocks"
    before = {name: ours.tensor(name) for name in module(method).history if name not in counted}
    skipping = OnGpu(method, DISPLAY)
    for given in sequence:
        skipping.step(given)
    color = np.asarray(sequence[-1].frame.color)
    last = Given(frame_at(len(sequence), color=color, exposure=1.25))
    for one in (ours, skipping):
        one.step(last)
        for name, kept in before.items():
            np.testing.assert_array_equal(one.tensor(name), kept, name)
    changed = Given(frame_at(len(sequence) + 1, light=3.0))
    np.testing.assert_array_equal(ours.step(changed)[0], skipping.step(changed)[0])


def test_a_change_after_freezing_restarts_pixels_as_in_torch() -> None:
    """A jump of light in a part of the image, and then a slow fade in another."""
    light = np.ones((*RENDER[::-1], 1), np.float32)
    sequence = still(2 * PERIOD + 2)
    light[:5, :7] = 1.3
    sequence += [Given(frame_at(index, light=light)) for index in range(len(sequence), len(sequence) + 9)]
    for index in range(len(sequence), len(sequence) + 40):
        light[9:, 12:] *= 1.0004
        sequence.append(Given(frame_at(index, light=light)))
    _, frozen = compare_steps(sequence, decisions=0.95)
    assert frozen[2 * PERIOD + 1] > 0.8
    assert frozen[2 * PERIOD + 8] < frozen[2 * PERIOD + 1]


WIDE, WIDE_DISPLAY = (144, 20), (288, 40)  # nine tiles side by side, so that images depend on few of them


def wide(index: int) -> Given:
    """A still scene, in which an object moves from frame 70 on, first in one tile, then through others."""
    frame = frame_at(index, WIDE)
    if index < 70:
        return Given(frame)
    motion, color, at = np.array(frame.motion), np.array(frame.color), 4 + 5 * max(index - 76, 0)
    motion[4:8, at : at + 3] = (-1.0, 0.0)
    color[4:8, at : at + 3] = 2.0
    return Given(frame_at(index, WIDE, motion=motion, color=color))


@pytest.mark.parametrize("method", ["taau", "classifier", "classifier-large"])
def test_frozen_pixels_stay_and_tiles_are_left_out_where_nothing_moves_without_a_changed_bit(
    method: str,
) -> None:
    """What is left out of them holds garbage, on which no image may depend."""
    whole, skipping = OnGpu(method, WIDE_DISPLAY, skip=False), OnGpu(method, WIDE_DISPLAY)
    held, frozen = np.zeros((*WIDE_DISPLAY[::-1], 3), np.float32), np.zeros(WIDE_DISPLAY[::-1], bool)
    for index in range(96):
        image, converged = whole.step(wide(index))
        assert converged is not None
        kept = frozen & (converged > 0.0)
        np.testing.assert_array_equal(image[kept], held[kept], f"frame {index}")
        frozen, held = converged > 0.0, image.copy()
        if index >= 70:
            assert frozen.any()
            spoil(skipping)
        np.testing.assert_array_equal(skipping.step(wide(index))[0], image, f"frame {index}")
        if index == 74 and method == "classifier":
            inputs = work_of(skipping, "inputs").reshape(WIDE_DISPLAY[1], WIDE_DISPLAY[0], 4)
            spoiled = (inputs == GARBAGE).all(axis=(0, 2))
            assert spoiled[5 * 32 :].all(), "five tiles from the object on, nothing is computed"
            assert not spoiled[: 2 * 32].any()
    for name in whole.executor.program.layout.spec.history:
        np.testing.assert_array_equal(whole.tensor(name), skipping.tensor(name), name)


GARBAGE = 0x7B7B7B7B


def test_blocks_beside_frozen_ones_are_decided_as_in_torch() -> None:
    """Means of frozen blocks are compared with samples only where others need it."""
    sequence = [wide(index) for index in range(100)]
    light = np.ones((*WIDE[::-1], 1), np.float32)
    light[:, 90:95] = 1.5
    sequence += [Given(frame_at(index, WIDE, light=light)) for index in range(100, 180)]
    _, frozen = compare_steps(sequence, WIDE_DISPLAY)
    assert frozen[69] == 1.0
    assert 0.3 < frozen[110] < 0.5 < frozen[-1]


BETWEEN_PASSES = (
    "inputs",
    "differences",
    "large_image",
    *(f"{part}{i}" for part in ("kept", "pooled") for i in range(4)),
)


def spoil(stepped: OnGpu) -> None:
    """Fill memory between passes with garbage."""
    memory = stepped.executor._buffers_for(WIDE, WIDE_DISPLAY).memory
    for name in memory.keys() & set(BETWEEN_PASSES):
        write_to(stepped.executor.device, memory[name], np.full_like(work_of(stepped, name), GARBAGE))


def work_of(stepped: OnGpu, name: str) -> NDArray[np.uint32]:
    memory = stepped.executor._buffers_for(WIDE, WIDE_DISPLAY).memory[name]
    words = read_back(stepped.executor.device, memory)
    if memory.texture is None:
        return words
    width, height = memory.texture.size[:2]
    return words.reshape(height, width, -1)


@pytest.mark.parametrize("method", ["taau", "classifier", "classifier-large"])
def test_memory_that_holds_a_frozen_tile_already_is_not_written(method: str) -> None:
    stepped = OnGpu(method, DISPLAY)
    for given in uniform(2 * PERIOD + 6):
        stepped.step(given)
    assert stepped.history is not None
    assert stepped.spare is not None
    gpu, pixels = stepped.executor, stepped.spare.memory["pixels"]
    marked = np.full_like(read_back(gpu.device, pixels), GARBAGE).reshape(*pixels.texture.size[1::-1], -1)
    write_to(gpu.device, pixels, marked)
    known, spare = stepped.history, stepped.spare
    image, _ = stepped.step(uniform(1)[0])
    assert np.ptp(image) == 0.0
    np.testing.assert_array_equal(read_back(gpu.device, spare.memory["pixels"]), marked.ravel())
    other = gpu.zeros(DISPLAY, RENDER)  # not the memory of the step before the last: all is written
    gpu.step_many([StepRequest(uniform(1)[0].frame, DISPLAY, known, other, image, adds_samples=1.0)])
    for name in ("color", "static_mean"):
        np.testing.assert_array_equal(gpu.tensor(other, name), gpu.tensor(known, name))


def movers() -> Iterator[Given]:
    """An object crosses a still scene, passes, and comes back once all is frozen."""
    for index in range(3 * PERIOD + 10):
        frame = frame_at(index)
        at = index if index < 12 else index - 2 * PERIOD - 10
        if 0 <= at < 12:
            motion, color = np.array(frame.motion), np.array(frame.color)
            motion[4:8, at : at + 3] = (-1.0, 0.0)
            color[4:8, at : at + 3] = 2.0
            frame = frame_at(index, motion=motion, color=color)
        yield Given(frame)


def noisy(frames: int, jitter_period: int = PERIOD) -> list[Given]:
    """Path-traced frames: every sample has its own noise; the light of a part jumps."""
    rng = np.random.default_rng(7)
    sequence = []
    for index in range(frames):
        light = rng.gamma(4.0, 0.25, (*RENDER[::-1], 1)).astype(np.float32)
        if index >= 24:
            light[:6, :10] *= 2.0
        sequence.append(Given(frame_at(index, light=light, period=jitter_period), NOISY))
    return sequence


def lit(light: Callable[[int], float]) -> list[Given]:
    return [Given(frame_at(index, light=light(index))) for index in range(2 * PERIOD + 10)]


def creeping(length: float) -> list[Given]:
    """Frames whose motion vectors have a length, render pixels."""
    motion = np.zeros((*RENDER[::-1], 2), np.float32)
    motion[..., 1] = length
    return [Given(frame_at(index, motion=motion)) for index in range(2 * PERIOD + 4)]


def repeated() -> list[Given]:
    """Some jitter comes twice, and some frames add no samples."""
    frames: list[Given] = []
    for index in range(2 * PERIOD + 6):
        frames += [Given(frame_at(index))] * (2 if index % 3 == 0 else 1)
        frames += [Given(frame_at(index), 0.0)] * (index % 7 == 0)
    return frames


def masked() -> list[Given]:
    mask = np.zeros(RENDER[::-1], np.float32)
    mask[5, 6], mask[10, 15] = 0.25, 1e-6
    frames = still(2 * PERIOD + 4)
    return frames + [Given(frame_at(len(frames) + index, reactive=mask)) for index in range(6)]


def with_a_cut() -> list[Given]:
    frames = still(2 * PERIOD + 4)
    frames[PERIOD + 8] = Given(frame_at(PERIOD + 8, reset=True))
    return frames


def invalid() -> list[Given]:
    """Invalid samples, with pre-exposure."""
    frames = []
    for index in range(2 * PERIOD + 4):
        color = 4.0 * np.asarray(frame_at(index).color)
        color[3, 4], color[8, 9, 1], color[2, 15], color[12, 3] = np.nan, np.nan, np.inf, -1.0
        frames.append(Given(frame_at(index, color=color, pre_exposure=4.0)))
    return frames


SEQUENCES: dict[str, tuple[Callable[[], list[Given]], float, float]] = {
    "growing light": (lambda: lit(lambda index: 1.0 + 0.004 * index), 0.0, 0.0),
    "fading light": (lambda: lit(lambda index: 1.0 - 0.012 * index), 0.0, 0.0),
    "light that blinks with the jitter": (lambda: lit(lambda index: 1.2 if index % 2 else 1.0), 0.0, 0.1),
    "motion below the limit": (lambda: creeping(1.0 / 300.0), 0.5, 1.0),
    "motion above the limit": (lambda: creeping(1.0 / 200.0), 0.0, 0.0),
    "repeated jitter and frames without samples": (repeated, 0.5, 1.0),
    "a path tracer's noise": (lambda: noisy(50), 0.0, 0.0),
    "a reactive mask": (masked, 0.01, 0.8),
    "a cut": (with_a_cut, 0.0, 0.0),
    "invalid samples": (invalid, 0.1, 1.0),
}
"""Frames, and the smallest and largest part of the last image that is frozen."""


@pytest.mark.parametrize("name", SEQUENCES)
def test_pixels_freeze_as_in_torch(name: str) -> None:
    make, low, high = SEQUENCES[name]
    _, frozen = compare_steps(make())
    assert low <= frozen[-1] <= high


@pytest.mark.parametrize(
    ("render", "display", "ratio"),
    [((21, 13), (32, 20), 1.5), ((17, 9), (17, 9), 1.0), ((9, 5), (27, 15), 3.0), ((1, 1), (2, 3), 2.0)],
)
def test_odd_sizes_and_ratios_freeze_as_in_torch(render: Size, display: Size, ratio: float) -> None:
    period = int(8 * ratio * ratio)
    sequence = still(2 * period + 4, render, period=period, ratio=ratio)
    compare_steps(sequence, display)


def test_blocks_restart_where_the_render_size_changes() -> None:
    sizes = [RENDER] * 40 + [(33, 21)] * 3 + [RENDER] * 40 + [(25, 16)] * 60
    sequence = [Given(frame_at(index, size)) for index, size in enumerate(sizes)]
    ours, frozen = compare_steps(sequence, decisions=0.95)
    assert max(frozen[:-1]) == 0.0
    assert ours.tensor("signatures").shape[0] == 9 * 44 * 28 // (25 * 16) + 2


def test_signatures_are_right_whichever_buffers_a_history_is_written_to() -> None:
    """A step that is repeated, from a history that is kept, and into buffers that hold another history."""
    gpu = executor("taau")

    def run(history: GpuHistory, into: GpuHistory, index: int) -> GpuHistory:
        image = np.empty((*DISPLAY[::-1], 3), np.float32)
        gpu.step_many([StepRequest(frame_at(index), DISPLAY, history, into, image, adds_samples=1.0)])
        return into

    sets = [gpu.zeros(DISPLAY, RENDER) for _ in range(4)]
    history = sets[0]
    for index in range(40):  # in turns of three sets; each third step is done twice
        into = sets[(index + 1) % 3]
        if index % 3 == 0:
            run(history, into, index + 5)
            run(history, sets[3], index + 7)
        history = run(history, into, index)
    plain = OnGpu("taau", DISPLAY)
    for index in range(40):
        plain.step(Given(frame_at(index)))
    for name in ("phases", "static_blocks", "static_mean"):
        np.testing.assert_array_equal(gpu.tensor(history, name), plain.tensor(name), name)
    used = plain.tensor("phases")[:, 2] > 0.0
    np.testing.assert_array_equal(gpu.tensor(history, "signatures")[used], plain.tensor("signatures")[used])


def test_a_saved_history_continues() -> None:
    gpu, ours = executor("taau"), OnGpu("taau", DISPLAY)
    sequence = list(movers())
    for given in sequence[:70]:
        ours.step(given)
    loaded = OnGpu("taau", DISPLAY)
    loaded.history = gpu.zeros(DISPLAY, RENDER)
    names = gpu.program.layout.spec.history
    gpu.load(loaded.history, {name: ours.tensor(name) for name in names})
    for name in names:
        np.testing.assert_array_equal(loaded.tensor(name), ours.tensor(name), name)
    for given in sequence[70:]:
        np.testing.assert_array_equal(loaded.step(given)[0], ours.step(given)[0])
