"""Kernels compiled for a classifier's config compute the same images as torch."""

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest

from noise import Size, noise
from random_networks import TINY, Made, compare, step_both, with_random_weights
from supersampler.methods.classifier.spec import CLASSIFIER, ClassifierConfig
from supersampler.methods.classifier.variant import Variant
from supersampler.methods.spec import flags_of
from supersampler_model.methods.classifier import Classifier

VARIANTS = [
    Variant(rectified=False, own_motion=False),
    Variant(rectified=False, own_motion=True),  # 15 outputs: those of four pixels are no multiple of eight
]


@pytest.fixture(scope="module", params=VARIANTS, ids=lambda variant: variant.kernel("with"))
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
    spots = np.random.default_rng(0).random((18, 32)) < 0.05
    spoilt: dict[str, Any] = {}
    for name in ("color", "depth", "motion"):
        spoilt[name] = np.array(getattr(frames[2], name), np.float32)
        spoilt[name][spots] = bad
    frames[2] = replace(frames[2], **spoilt)
    pairs = step_both(made, frames, (64, 36))
    assert all(np.isfinite(theirs).all() and theirs.min() >= 0.0 for _, theirs in pairs)
    compare(pairs)


def test_a_variant_says_what_its_config_counts() -> None:
    for rectified in (False, True):
        for own in (False, True):
            variant = Variant(rectified, own)
            config = ClassifierConfig(rectified=rectified, own_motion=own)
            assert variant == Variant.of(asdict(config))
            assert variant == Variant.with_parts(*variant.kernel("module.function").split("+")[1:])
            assert variant.blend_parameters == config.blend_parameters
