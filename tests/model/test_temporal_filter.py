"""The CPU library's temporal filter is the one that torch defines."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import noisy_frames
from supersampler import Shot
from supersampler.backends.cpu.library import TemporalData, cpu_library
from supersampler.denoising import spec, temporal
from supersampler.denoising.spec import OF_DENOISED, OF_NOISY, REACH
from supersampler.denoising.temporal import TemporalFilter
from supersampler.errors import ShotError, SupersamplerError
from supersampler.frame import Array
from supersampler.io.shot import ShotWriter
from supersampler_model.denoising import filter as definition
from supersampler_model.denoising.training import (
    LEAST_GAINS,
    Render,
    constants,
    example_of,
    fit,
    gains,
    planes,
    render_of,
)


def frames_of(
    size: tuple[int, int], count: int, *, motion: float = 1.5, noisy: bool = False
) -> tuple[list[temporal.WindowFrame], list[definition.WindowFrame]]:
    """Return the same random frames for the library and for torch; one has a missing sample."""
    width, height = size
    generator = np.random.default_rng(width)
    base = generator.random((height, width, 3))
    ours, theirs = [], []
    for index in range(count):
        color = (base + 0.05 * generator.random((height, width, 3))).astype(np.float32)
        if index == 1:
            color[height // 2, width // 3] = np.nan
        albedo = 0.1 * generator.random((height, width, 3), np.float32)
        normal = 0.2 * (generator.random((height, width, 3), np.float32) - 0.5)
        aovs = generator.random((height, width, 5), np.float32)
        depth = generator.random((height, width), np.float32)
        back, on = (
            temporal.nearest_motion(depth, motion * generator.standard_normal((height, width, 2)))
            for _ in range(2)
        )
        grain = temporal.packed_color(2.0 * generator.random((height, width, 3))) if noisy else None
        packed = temporal.packed_color(color)
        guides = temporal.packed_guides(albedo, normal, (height, width))
        ours.append(temporal.WindowFrame(packed, guides, back, on, temporal.packed_aovs(aovs), grain))
        tensors = map(planes, (packed, albedo, normal, back, on, aovs))
        frame = definition.WindowFrame(*tensors)
        theirs.append(replace(frame, noisy=None if grain is None else planes(grain)))
    return ours, theirs


@pytest.mark.parametrize("size", [(1, 1), (3, 2), (13, 17), (80, 48), (150, 37)])
@pytest.mark.parametrize(
    ("motion", "exposure", "samples"),
    [(1.5, 1.0, 4.0), (0.4, 0.1, 0.5), (60.0, 30.0, 1.0), (0.2, 1.0, 1000.0)],
)
@pytest.mark.parametrize("noisy", [False, True])
def test_the_library_computes_the_images_of_the_definition(
    size: tuple[int, int], motion: float, exposure: float, samples: float, noisy: bool
) -> None:
    ours, theirs = frames_of(size, 6, motion=motion, noisy=noisy)
    with TemporalFilter(threads=2) as library:
        image, groups = library.filter(ours[0], ours[1:4], ours[4:], exposure, samples)
    defined = definition.TemporalFilter(OF_NOISY if noisy else OF_DENOISED)
    with torch.no_grad():
        color, aovs = defined(theirs[0], theirs[1:4], theirs[4:], exposure, samples)
    assert aovs is not None
    for array, tensor in ((image[..., :3], color), (np.concatenate(groups, axis=2)[..., :5], aovs)):
        error = np.abs(array - tensor[0].permute(1, 2, 0).numpy())
        assert error.mean() < 2e-6
        assert np.quantile(error, 0.999) < 2e-5
        assert error.max() < 2e-4


def test_neighbours_beyond_the_reach_are_not_read() -> None:
    ours, _ = frames_of((20, 11), REACH + 3)
    with TemporalFilter(threads=1) as library:
        whole, _ = library.filter(ours[0], ours[1:], [])
        part, _ = library.filter(ours[0], ours[1 : REACH + 1], [])
    np.testing.assert_array_equal(whole, part)


def test_the_nearest_motion_is_that_of_the_closest_neighbour() -> None:
    generator = np.random.default_rng(0)
    depth = generator.random((9, 14), np.float32)
    motion = generator.standard_normal((9, 14, 2)).astype(np.float32)
    motion[2, 3] = np.nan, np.inf
    expected = definition.nearest_motion(torch.from_numpy(depth)[None, None], planes(motion))
    torch.testing.assert_close(planes(temporal.nearest_motion(depth, motion)), expected, rtol=0, atol=0)


def test_wrong_arguments_of_the_library_are_errors() -> None:
    with pytest.raises(SupersamplerError, match="frames is NULL"):
        cpu_library().call("ss_filter_temporal", TemporalData(4, 3))


def test_a_change_of_light_counts_more_than_noise_of_its_size() -> None:
    guide, still = torch.zeros(1, 3, 24, 24), torch.zeros(1, 2, 24, 24)
    signs = torch.where(torch.rand(1, 3, 24, 24, generator=torch.Generator().manual_seed(0)) < 0.5, -0.3, 0.3)

    def frame(stops: torch.Tensor) -> definition.WindowFrame:
        color = torch.cat([0.2 * torch.exp2(stops), torch.ones(1, 1, 24, 24)], dim=1)
        return definition.WindowFrame(color, guide, guide, still, still)

    def weight(other: torch.Tensor) -> float:
        gathered = definition.gathered(frame(0.0 * signs), [frame(other)], "to_previous")
        distances = definition.distances(frame(0.0 * signs), gathered[0], 1.0)
        return definition.TemporalFilter().weight(distances, 4.0).mean().item()

    assert weight(signs.abs()) < 0.7 * weight(signs)


@pytest.mark.parametrize("guide", ["albedo", "normal", "color"])
def test_the_more_samples_the_less_a_neighbour_that_differs_counts(guide: str) -> None:
    still, base = torch.zeros(1, 2, 24, 24), torch.full((1, 3, 24, 24), 0.4)

    def frame(**changed: torch.Tensor) -> definition.WindowFrame:
        planes = {"color": base, "albedo": base, "normal": base, **changed}
        color = torch.cat([planes["color"], torch.ones(1, 1, 24, 24)], dim=1)
        return definition.WindowFrame(color, planes["albedo"], planes["normal"], still, still)

    def weight(other: definition.WindowFrame, samples: float) -> float:
        gathered = definition.gathered(frame(), [other], "to_previous")
        distances = definition.distances(frame(), gathered[0], 1.0)
        return model().weight(distances, samples).mean().item()

    other = frame(**{guide: base + 0.15})
    assert weight(other, 8.0) < 0.9 * weight(other, 1.0) < 0.9 * weight(frame(), 1.0)
    assert weight(frame(), 8.0) == pytest.approx(weight(frame(), 1.0))
    assert weight(other, 1e4) == weight(other, spec.MAX_SAMPLES)


def test_fitting_learns_which_neighbours_to_trust() -> None:
    generator = np.random.default_rng(0)
    height, width = 40, 60
    clean = generator.random((height, width, 3), np.float32)

    def frame(color: Array) -> definition.WindowFrame:
        guide, still = torch.zeros(1, 3, height, width), torch.zeros(1, 2, height, width)
        return definition.WindowFrame(planes(temporal.packed_color(color)), guide, guide, still, still)

    def noise() -> Array:
        return (clean * (1.0 + 0.3 * generator.standard_normal(clean.shape))).clip(0.0).astype(np.float32)

    other = generator.random((height, width, 3), np.float32)
    example = example_of(frame(noise()), [frame(noise())], [frame(other)], planes(clean), 4.0)
    render = Render([example], 4.0)
    fitted, before = fit([render], rounds=60), model()
    with torch.no_grad():
        trusted, first = (
            each.weight(example.distances, 4.0).mean(dim=(1, 2, 3)) for each in (fitted, before)
        )
        psnr, _, seen = gains(fitted, render)
    assert trusted[0] > 1.5 * first[0]
    assert trusted[0] > 5.0 * trusted[1]
    assert psnr > LEAST_GAINS[0]
    assert seen > LEAST_GAINS[1]
    assert constants(before) == OF_DENOISED


def test_examples_come_from_the_frames_with_references(tmp_path: Path) -> None:
    with ShotWriter(tmp_path, name="noisy", display_size=noisy_frames.SIZE, frame_rate=24.0) as writer:
        for index in range(5):
            reference = noisy_frames.truth(index) if index in (1, 3) else None
            writer.write(noisy_frames.noisy(index), reference=reference)
    shot = Shot.open(tmp_path)
    shot.is_denoised = True
    render = render_of(shot, 2.0)
    first, second = render.examples
    width, height = noisy_frames.SIZE
    assert first.colors.shape == (4, 3, height, width)
    assert second.own.shape == first.own.shape
    assert bool(first.scored.all())
    psnr, tpsnr, seen = gains(model(), render).tolist()
    assert psnr > 2.0
    assert tpsnr > 2.0
    assert seen > 0.1
    with ShotWriter(tmp_path / "bare", name="bare", display_size=(8, 8), frame_rate=24.0) as writer:
        writer.write(noisy_frames.noisy(0))
    bare = Shot.open(tmp_path / "bare")
    bare.is_denoised = True
    with pytest.raises(ShotError, match="bare: no frame has a reference of its own size"):
        render_of(bare, 2.0)


def model() -> definition.TemporalFilter:
    return definition.TemporalFilter().requires_grad_(False)
