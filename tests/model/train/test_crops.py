"""Crops equal the whole frame at any ratio and with any augmentation; fireflies and path-tracing noise."""

import dataclasses
import itertools
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.nn import functional as F

import gbuffer_sets
from gbuffer_sets import gbuffer_data, training_frame
from supersampler import halton_jitter
from supersampler.errors import ArgumentError
from supersampler.frame import Float32
from supersampler.io.display import MAX_HALF
from supersampler_model import ops
from supersampler_model.data.dataset.storage import Dataset, TrainingFrame
from supersampler_model.data.scenes.analytic import DiscOverPlane
from supersampler_model.methods.classifier import Classifier
from supersampler_model.training.classifier_tasks import ClassifierTask
from supersampler_model.training.crops import (
    FIREFLY_CHANCE,
    NOISE_CHANCE,
    SAMPLES,
    CropFrame,
    CropRegion,
    PathNoise,
    Stream,
    StreamPosition,
    with_fireflies,
)
from supersampler_model.training.datasets import gbuffer_set, method_inputs
from torch_inputs import step_by_name

pytest_plugins = ["training_fixtures"]

DISPLAY = (96, 64)
FRAMES = 3
RATIO = 2
aligned_region = partial(CropRegion, gbuffers="both", aligned=True)
draw_aligned = partial(CropRegion.draw, gbuffers="both", aligned=True)
aligned_stream = partial(Stream, ratios=(RATIO, RATIO), gbuffers="both", aligned=True)
ACROSS = torch.tensor([-1.0, 1.0])
COLOR = torch.rand(1, 3, 64, 64, generator=torch.Generator().manual_seed(0))


def frames(render: tuple[int, int]) -> list[TrainingFrame]:
    scene, made = DiscOverPlane(start=(22.0, 14.0)), []
    for index in range(FRAMES):
        x, y = halton_jitter(index, DISPLAY[0] / render[0])
        frame = scene.frame(index, render, (x + 0.013, y - 0.007))  # on no sample: ties are not symmetric
        made.append(training_frame(frame, np.zeros((*DISPLAY[::-1], 3), np.float16)))
    return made


def whole(sequence: list[TrainingFrame]) -> torch.Tensor:
    method = Classifier().eval()
    history = method.first_history(ops.Size(*DISPLAY), ops.Size(*sequence[0].depth.shape[::-1]))
    for frame in sequence:
        image, history, _ = step_by_name(method, method_inputs(frame, method.inputs()), history)
    shown: torch.Tensor = image
    return shown


def cropped(sequence: list[TrainingFrame], cut: CropRegion) -> torch.Tensor:
    task = ClassifierTask(Classifier().eval())
    states = [task.first_state(cut.cut(sequence[0], reset=True))]
    for frame in sequence:
        with torch.no_grad():
            stepped = task.step([cut.cut(frame, reset=frame.reset)], states)
        states = stepped.states
    return stepped.images


@pytest.mark.parametrize("render", [(96, 64), (64, 43), (48, 32), (32, 21)])
def test_crops_at_all_places_of_a_frame_read_as_many_samples(render: tuple[int, int]) -> None:
    frame, size = frames(render)[0], 40
    shapes = set()
    for left, top in itertools.product(range(DISPLAY[0] - size + 1), range(DISPLAY[1] - size + 1)):
        shapes.add(CropRegion(left=left, top=top, size=size).cut(frame, reset=True).color.shape)
    assert len(shapes) == 1


@pytest.mark.parametrize(
    ("render", "flip", "turned"),
    [
        ((96, 64), (False, False), False),
        ((64, 43), (True, False), True),
        ((48, 32), (False, True), False),
        ((48, 32), (True, True), True),
        ((32, 21), (False, False), True),
    ],
)
def test_a_crop_renders_the_part_of_the_whole_image(
    render: tuple[int, int], flip: tuple[bool, bool], turned: bool
) -> None:
    sequence = frames(render)
    cut = CropRegion(left=31, top=9, size=40, flip=flip, turned=turned)
    part = whole(sequence)[:, :, 9:49, 31:71]
    part = part.flip(3) if flip[0] else part
    part = part.flip(2) if flip[1] else part
    part = part.transpose(2, 3) if turned else part
    inside = np.s_[:, :, 12:-12, 12:-12]  # pixels whose history lies within the crop
    assert torch.allclose(cropped(sequence, cut)[inside], part[inside], atol=1e-3)


def test_a_gain_of_the_colours_alone_scales_the_image() -> None:
    sequence = frames((48, 32))
    cut = CropRegion(left=31, top=9, size=40)
    brighter = dataclasses.replace(cut, gain=4.0)
    assert torch.allclose(cropped(sequence, brighter), 4.0 * cropped(sequence, cut), rtol=1e-3, atol=1e-4)


def test_fireflies_strike_a_few_frames_in_colour_alone_and_stay_in_range() -> None:
    frame = frames((48, 32))[0]
    sample = CropRegion(left=31, top=9, size=40).cut(frame, reset=True)
    made = [with_fireflies(sample, np.random.default_rng(seed)) for seed in range(400)]
    struck = [other for other in made if not torch.equal(other.color, sample.color)]
    assert 0.5 * FIREFLY_CHANCE < len(struck) / len(made) < 2.0 * FIREFLY_CHANCE
    for other in struck:
        bright = other.color > sample.color
        assert bright.all(dim=1).sum() == bright.any(dim=1).sum(), "of all channels"
        assert 0.0 < bright.float().mean() < 0.2
        assert other.color.max() <= 65504.0
        assert torch.equal(other.reference, sample.reference)


@pytest.fixture(scope="module")
def dataset(data: Dataset) -> Dataset:
    return gbuffer_set(data, RATIO)


def stored_frames(dataset: Dataset) -> list[TrainingFrame]:
    return list(dataset.frames(dataset.entries("train")[0]))


def test_a_crop_is_the_slice_of_the_frame_and_looks_at_it_with_its_jitter(dataset: Dataset) -> None:
    frame = stored_frames(dataset)[3]
    sample = aligned_region(left=8, top=4, size=24).cut(frame, reset=False)
    inner, outer = np.s_[2:14, 4:16], np.s_[4:28, 8:32]
    wanted = {name: getattr(frame, name)[inner] for name in ("color", "depth", "motion")}
    wanted["reference"] = frame.reference[outer]
    found = {name: getattr(sample, name) for name in wanted} | dict(sample.gbuffer)
    wanted |= {f"gbuffer_{name}": buffer[inner] for name, buffer in (frame.gbuffer or {}).items()}
    shown = (frame.gbuffer_display or {}).items()
    wanted |= {f"gbuffer_display_{name}": buffer[outer] for name, buffer in shown}
    assert found.keys() == wanted.keys() >= {"gbuffer_normal", "gbuffer_display_depth"}
    for name, part in wanted.items():
        values = np.atleast_3d(part).astype(np.float32) / (255.0 if part.dtype == np.uint8 else 1.0)
        np.testing.assert_array_equal(found[name][0].permute(1, 2, 0).numpy(), values.astype(np.float32))
    assert torch.equal(sample.view.jitter, torch.tensor([frame.jitter], dtype=torch.float32))
    assert sample.view.extent == (12.0, 12.0)


@pytest.mark.parametrize(
    ("across", "down", "turned"), list(itertools.product([False, True], [False, True], [False, True]))
)
def test_jitter_motion_and_buffers_agree_however_a_crop_is_turned(
    dataset: Dataset, across: bool, down: bool, turned: bool
) -> None:
    cut = aligned_region(left=8, top=6, size=30, flip=(across, down), turned=turned, colors=(2, 0, 1))
    before, now = (cut.cut(stored_frames(dataset)[index], reset=False) for index in (1, 2))
    jitter, motion = now.view.jitter[0], now.motion[0]
    still = torch.zeros_like(motion)
    assert off(now, now, jitter, still) < 0.02
    assert off(now, before, jitter, motion) < 0.02
    for mistaken in (jitter * ACROSS, -jitter * ACROSS, jitter.flip(0)):
        assert off(now, now, mistaken, still) > 0.04
    for mistaken in (motion * ACROSS[:, None, None], -motion * ACROSS[:, None, None], motion.flip(0)):
        assert off(now, before, jitter, mistaken) > 0.1


def off(now: CropFrame, then: CropFrame, jitter: Tensor, motion: Tensor) -> float:
    """Largest difference of what samples of render size see to what is of display size where they lie."""
    size = now.color.shape[2]
    row, column = torch.meshgrid(torch.arange(size), torch.arange(size), indexing="ij")
    at = torch.stack([column, row]) + 0.5 + jitter[:, None, None] + motion
    grid = (2.0 * at / size - 1.0).permute(1, 2, 0)[None]

    def differ(seen: Tensor, buffer: str) -> float:
        there = F.grid_sample(then.gbuffer[f"gbuffer_display_{buffer}"], grid, align_corners=False)
        return (seen - there)[:, :, 3:-3, 3:-3].abs().max().item()

    names = ("base_color", "roughness", "metallic", "specular")
    return max(
        differ(now.color, "base_color"),
        differ(now.depth, "depth"),
        *(differ(now.gbuffer[f"gbuffer_{name}"], name) for name in names),
    )


def test_normals_are_rotated_alike_and_stay_zero_at_the_sky(dataset: Dataset) -> None:
    frame, entry = stored_frames(dataset)[3], dataset.entries("train")[0]
    drawn = draw_aligned(np.random.default_rng(0), entry, gbuffer_sets.DISPLAY, 28)
    np.testing.assert_allclose(drawn.world @ drawn.world.T, np.eye(3), atol=1e-6)
    plain = aligned_region(left=8, top=0, size=28)
    turned = CropRegion(**{**vars(plain), "world": drawn.world})
    found = []
    for cut in (plain, turned):
        sample = cut.cut(frame, reset=False)
        normals = [sample.gbuffer[f"gbuffer_{size}normal"].flatten(2)[0] for size in ("", "display_")]
        found.append((normals, torch.cat(normals, dim=1)))
    (parts, a), (_, b) = found
    assert not torch.allclose(a, b, atol=0.1)
    torch.testing.assert_close(a.T @ a, b.T @ b, rtol=0.0, atol=1e-5)
    for part in parts:
        assert (part == 0.0).all(dim=0).any()
    assert torch.equal((a == 0.0).all(dim=0), (b == 0.0).all(dim=0))


def test_worlds_are_mirrored_as_often_as_not_and_differ(dataset: Dataset) -> None:
    random, entry = np.random.default_rng(0), dataset.entries("train")[0]
    cuts = [draw_aligned(random, entry, gbuffer_sets.DISPLAY, 28) for _ in range(100)]
    assert all(cut.left % RATIO == cut.top % RATIO == 0 for cut in cuts)
    assert {cut.left for cut in cuts} == set(range(0, gbuffer_sets.DISPLAY[0] - 28 + 1, RATIO))
    mirrored = [np.linalg.det(cut.world) < 0.0 for cut in cuts]
    assert 30 < sum(mirrored) < 70
    assert np.abs(np.mean([cut.world for cut in cuts], axis=0)).max() < 0.2


def test_base_colours_have_the_order_of_the_colours(dataset: Dataset) -> None:
    random, entry = np.random.default_rng(0), dataset.entries("train")[0]
    for frame in stored_frames(dataset):
        cut = draw_aligned(random, entry, gbuffer_sets.DISPLAY, 28)
        sample = cut.cut(frame, reset=False)
        shining = cut.gain * sample.gbuffer["gbuffer_base_color"]  # everything shines by itself
        torch.testing.assert_close(sample.color, shining, rtol=0.0, atol=0.005 * cut.gain)


def test_a_stream_resumes_exactly(dataset: Dataset) -> None:
    whole = aligned_stream([dataset], size=28, seed=[3])
    walk = iter(whole)
    for _ in range(8):
        next(walk)
    again = aligned_stream([dataset], size=28, seed=[3])
    again.position = StreamPosition(**asdict(whole.position))
    for one, other in zip(itertools.islice(walk, 9), again, strict=False):
        assert torch.equal(one.color, other.color)
        assert torch.equal(one.view.jitter, other.view.jitter)
        assert one.reset == other.reset
        for name, buffer in one.gbuffer.items():
            assert torch.equal(buffer, other.gbuffer[name]), name


def test_crops_with_noise_have_other_noise_in_each_frame_and_in_colour_alone(
    dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    clean = list(itertools.islice(aligned_stream([dataset], size=28, seed=[3]), 3))
    monkeypatch.setattr(PathNoise, "draw", lambda _: PathNoise(4, certain=0.0, missed=0.0, spread=0.6))
    noisy = list(itertools.islice(aligned_stream([dataset], size=28, seed=[3]), 3))
    factors = []
    for one, other in zip(noisy, clean, strict=True):
        assert torch.equal(one.depth, other.depth)
        assert torch.equal(one.reference, other.reference)
        lit = other.color > 0.0
        factors.append((one.color / other.color)[lit])
        assert 0.9 < factors[-1].mean() < 1.1
        assert 0.2 < factors[-1].std() < 0.5
    assert factors[0].shape != factors[1].shape or not torch.allclose(factors[0], factors[1], atol=0.1)


def test_missing_parts_of_a_set_are_named(tmp_path: Path) -> None:
    bare = gbuffer_data(tmp_path / "bare", gbuffers=False)
    with pytest.raises(ArgumentError, match=r"without G-buffers of display size.*--gbuffers --also 2"):
        gbuffer_set(bare, 2)
    with pytest.raises(ArgumentError, match=r"without frames at ratio 4.*--also 4"):
        gbuffer_set(gbuffer_data(tmp_path / "full"), 4)
    with pytest.raises(ArgumentError, match=r"64x36.*multiple of 8"):
        gbuffer_set(bare, 8)


def test_crops_of_parts_of_render_pixels_are_refused(dataset: Dataset) -> None:
    with pytest.raises(ArgumentError, match="multiple of 2"):
        aligned_stream([dataset], size=27, seed=[0])


def noise(samples: int, *, certain: float = 0.0, missed: float = 0.0, spread: float = 1.0) -> PathNoise:
    return PathNoise(samples, certain, missed, spread)


def ratios(of: PathNoise, seed: int = 0) -> Float32:
    noisy = of.on(COLOR, np.random.default_rng(seed))
    found: Float32 = (noisy / COLOR)[0].numpy()
    return found


@pytest.mark.parametrize("of", [noise(16), noise(16, certain=0.8), noise(16, missed=0.3, spread=0.6)])
def test_noise_keeps_the_mean(of: PathNoise) -> None:
    means = [ratios(of, seed).mean() for seed in range(8)]
    assert np.mean(means) == pytest.approx(1.0, abs=0.02)


def test_four_times_the_samples_halve_the_noise() -> None:
    few, many = (np.std([ratios(noise(n, spread=0.6), s) for s in range(4)]) for n in (4, 16))
    assert few / many == pytest.approx(2.0, rel=0.1)


def test_paths_without_light_leave_pixels_black() -> None:
    black = (ratios(noise(1, missed=0.3)) == 0.0).mean()
    assert black == pytest.approx(0.3, abs=0.03)


def test_bright_surfaces_have_less_noise_than_dark_ones_where_light_is_certain() -> None:
    scene = torch.cat([torch.full((1, 3, 32, 64), 0.1), torch.full((1, 3, 32, 64), 4.0)], dim=2)
    found = (noise(4, certain=0.8).on(scene, np.random.default_rng(1)) / scene)[0, 0]
    assert found[32:].std() < 0.6 * found[:32].std()


def test_the_brightest_light_stays_a_half_float() -> None:
    bright = noise(1, spread=1.3).on(torch.full((1, 3, 64, 64), 60000.0), np.random.default_rng(2))
    assert bright.max() == MAX_HALF


def test_a_few_crops_have_noise_and_the_same_seed_draws_the_same() -> None:
    drawn = [PathNoise.draw(np.random.default_rng(seed)) for seed in range(2000)]
    noisy = [one for one in drawn if one is not None]
    assert len(noisy) / len(drawn) == pytest.approx(NOISE_CHANCE, rel=0.3)
    assert {one.samples for one in noisy} == set(SAMPLES)
    assert drawn[:50] == [PathNoise.draw(np.random.default_rng(seed)) for seed in range(50)]
