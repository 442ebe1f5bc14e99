"""`network.npz` is written for networks that the CPU kernels support; these compute the same as torch."""

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest

from noise import Size, noise
from random_networks import TINY, Made, compare, step_both, with_random_weights
from supersampler import Frame
from supersampler.methods.classifier.spec import CLASSIFIER, ClassifierConfig, NetworkConfig
from supersampler.methods.classifier.variant import Variant
from supersampler.methods.gbuffer_fast.spec import GBUFFERS_READ, GuidedConfig
from supersampler.methods.gbuffers import GBUFFERS, grouped
from supersampler.methods.spec import flags_of
from supersampler_export.quantize import _fits, cpu_network
from supersampler_model.methods.classifier import Classifier
from supersampler_model.methods.classifier_paper import PaperClassifier
from supersampler_model.methods.gbuffer_fast import GuidedClassifier
from supersampler_model.methods.taau import Taau

LARGEST = NetworkConfig(levels=(32, 64, 128, 256), decoder=32, decoder_layers=1, hidden=58)
VARIANTS = [
    Variant(rectified=False, own_motion=False),
    Variant(rectified=False, own_motion=True),  # 15 outputs: those of four pixels are no multiple of eight
]


def with_bad_pixels(frame: Frame, bad: float) -> Frame:
    """Replace some pixels of every image."""
    spots, fields = np.random.default_rng(0).random((18, 32)) < 0.05, dict[str, Any]()
    for name in ("color", "depth", "motion"):
        fields[name] = np.array(getattr(frame, name), np.float32)
        fields[name][spots] = bad
    return replace(frame, **fields)


def fits(**widths: object) -> bool:
    return _fits(ClassifierConfig(network=replace(LARGEST, **widths)))  # type: ignore[arg-type]


def test_the_largest_network_fits() -> None:
    assert fits()


@pytest.mark.parametrize(
    "widths",
    [
        {"levels": (48, 64, 128, 256)},
        {"levels": (32, 80, 128, 256)},
        {"levels": (32, 64, 160, 256)},
        {"levels": (32, 64, 128, 320)},
        {"levels": (24, 64, 128, 256)},
        {"levels": (32, 64, 128, 248)},
        {"levels": (32, 64, 128)},
        {"levels": (32, 64, 128, 256, 256)},
        {"decoder": 33},
        {"decoder_layers": 2},
        {"decoder_layers": 0},
        {"hidden": 59},
    ],
)
def test_a_network_that_is_larger_or_of_uneven_widths_does_not(widths: dict[str, object]) -> None:
    assert not fits(**widths)


def test_smaller_networks_fit() -> None:
    assert fits(levels=(16, 16, 16, 16), decoder=8, hidden=1)


@pytest.mark.parametrize("method", [Taau(), PaperClassifier(), Classifier(ClassifierConfig(recurrent=False))])
def test_there_is_none_for_other_methods_and_other_constants(method: object) -> None:
    assert cpu_network(method) is None  # type: ignore[arg-type]


@pytest.fixture(scope="module", params=VARIANTS, ids=str)
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Made:
    config = ClassifierConfig(network=TINY, **{n: getattr(request.param, n) for n in flags_of(CLASSIFIER)})
    return with_random_weights(Classifier(config), tmp_path_factory.mktemp("model"))


@pytest.mark.parametrize(
    ("render", "display"), [((33, 17), (50, 27)), ((61, 35), (61, 35)), ((5, 40), (11, 93)), ((1, 1), (2, 2))]
)
def test_every_variant_computes_what_torch_computes(made: Made, render: Size, display: Size) -> None:
    compare(step_both(made, [noise(seed, render) for seed in range(4)], display))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0, 1e30])
def test_hostile_pixels_do_the_same_to_every_variant(made: Made, bad: float) -> None:
    frames = [noise(seed) for seed in range(4)]
    frames[2] = with_bad_pixels(frames[2], bad)
    pairs = step_both(made, frames, (64, 36))
    assert all(np.isfinite(theirs).all() and theirs.min() >= 0.0 for _, theirs in pairs)
    compare(pairs)


def test_a_variant_says_what_its_config_counts() -> None:
    for rectified in (False, True):
        for own in (False, True):
            variant = Variant(rectified, own)
            config = ClassifierConfig(rectified=rectified, own_motion=own)
            assert variant == Variant.of(asdict(config))
            assert variant.blend_parameters == config.blend_parameters


@pytest.fixture(scope="module")
def guided(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return with_random_weights(GuidedClassifier(GuidedConfig(network=TINY)), tmp_path_factory.mktemp("model"))


def surfaces(seed: int, render: Size, display: Size) -> dict[str, Any]:
    """Return G-buffers of patches of colour that face this way or that; the sky above."""
    made: dict[str, Any] = {}
    for name in GBUFFERS_READ:
        width, height = display if GBUFFERS[name].of_display else render
        y, x = np.mgrid[:height, :width].astype(np.float32)
        u, v = (x + 0.5) / width, (y + 0.5) / height
        wave = np.sin(9.0 * u + seed) * np.cos(7.0 * v)
        if name.endswith("base_color"):
            made[name] = np.stack([0.5 + 0.5 * wave, (wave > 0.0) * 1.0, u], -1).astype(np.float32)
        elif name.endswith("normal"):
            normal = np.stack([wave, 0.3 * wave, 1.0 + 0.0 * wave], -1)
            made[name] = (normal / np.linalg.norm(normal, axis=-1, keepdims=True)).astype(np.float32)
            made[name][v < 0.2] = 0.0
        else:
            made[name] = (0.02 + 0.01 * (np.sin(0.3 * u * render[0]) > 0.3)).astype(np.float32)
    return made


def surfaced(seed: int, render: Size, display: Size) -> Frame:
    """Return a frame of noise with the G-buffers that the method reads."""
    gbuffer, gbuffer_display = grouped(surfaces(seed, render, display))
    return noise(seed, render, gbuffer=gbuffer, gbuffer_display=gbuffer_display)


def test_half_floats_are_read_as_the_numbers_that_they_are(guided: Made) -> None:
    display, halves = (64, 36), []
    for seed in range(3):
        buffers = surfaces(seed, (32, 18), display)
        for name in buffers:
            buffers[name] = buffers[name].astype(np.float32 if name.endswith("depth") else np.float16)
        gbuffer, gbuffer_display = grouped(buffers)
        halves.append(noise(seed, gbuffer=gbuffer, gbuffer_display=gbuffer_display))
    compare(step_both(guided, halves, display))


@pytest.mark.parametrize(
    ("render", "display"),
    [
        ((33, 17), (50, 27)),
        ((61, 35), (61, 35)),
        ((21, 13), (63, 39)),
        ((16, 10), (64, 40)),
        ((1, 1), (2, 2)),
    ],
)
def test_the_kernels_compute_what_torch_computes(guided: Made, render: Size, display: Size) -> None:
    compare(step_both(guided, [surfaced(seed, render, display) for seed in range(4)], display))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -2.0, 1e30])
def test_hostile_pixels_do_the_same_to_both(guided: Made, bad: float) -> None:
    display = (64, 36)
    frames = [surfaced(seed, (32, 18), display) for seed in range(4)]
    buffers = surfaces(2, (32, 18), display)
    for buffer in buffers.values():
        buffer[np.random.default_rng(1).random(buffer.shape[:2]) < 0.05] = bad
    gbuffer, gbuffer_display = grouped(buffers)
    buffers_only = replace(frames[2], gbuffer=gbuffer, gbuffer_display=gbuffer_display)
    frames[2] = with_bad_pixels(buffers_only, bad)
    pairs = step_both(guided, frames, display)
    assert all(np.isfinite(theirs).all() and theirs.min() >= 0.0 for _, theirs in pairs)
    compare(pairs)
