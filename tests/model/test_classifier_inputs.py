"""What the classifier's network is shown."""

import numpy as np
import pytest
import torch

from noise import noise
from supersampler.methods.classifier.spec import CLASSES, DEFAULT_INPUTS, NEIGHBOURHOOD_INPUTS, CountCode
from supersampler_model import ops
from supersampler_model.methods.classifier import Classifier
from supersampler_model.methods.classifier_inputs import (
    COUNTS,
    Gathered,
    History,
    neighbourhood_inputs,
    pixel_inputs,
)

DISPLAY = ops.Size(47, 27)


def gathered(value: float | None = None) -> Gathered:
    """A frame of noise with a history of noise, `value` here and there in every image."""
    frame = noise(1)
    assert frame.color is not None
    method, random = Classifier(), np.random.default_rng(3)
    images = [
        torch.from_numpy(np.ascontiguousarray(a, np.float32))[None]
        for a in (frame.color.transpose(2, 0, 1), frame.depth[None], frame.motion.transpose(2, 0, 1))
    ]
    history_color, state, classes, depth, *_ = method.first_history(DISPLAY, ops.Size(32, 18))
    history_color = torch.from_numpy(random.gamma(0.5, 2.0, history_color.shape).astype(np.float32))
    state = torch.from_numpy(random.uniform(0.0, 1.0, state.shape).astype(np.float32))
    if value is not None:
        for image in (*images, history_color):
            image[torch.from_numpy(random.random(image.shape) < 0.1)] = value
    history = History(history_color, state, classes, depth + 0.02, torch.ones(1))
    view = ops.View(DISPLAY, ops.Size(32, 18), torch.tensor([frame.jitter]))
    with torch.no_grad():
        color, depth, motion = images
        return method.gather(color, depth, motion, torch.ones(1), history, view, view)


@pytest.mark.parametrize("value", [None, float("nan"), float("inf"), -1.0, 65504.0, 1e-40])
def test_all_that_the_network_sees_is_about_one_at_most(value: float | None) -> None:
    packed, half = Classifier().network_inputs(gathered(value))
    assert tuple(packed.shape) == (1, 4 * len(DEFAULT_INPUTS), 16, 24)
    assert tuple(half.shape) == (1, CLASSES + len(NEIGHBOURHOOD_INPUTS), 16, 24)
    for seen in (packed, half):
        assert seen.isfinite().all()
        assert seen.min() >= -1.0
        assert seen.max() <= 1.001


def test_differences_of_a_frame_and_the_same_history_are_zero() -> None:
    g = gathered()
    history_color = g.warped._replace(rounded=g.current.sample, detail=torch.zeros_like(g.warped.detail))
    seen = pixel_inputs(g._replace(warped=history_color))
    for name in ("history_to_sample", "beyond_range"):
        assert not seen[name].any(), name
    assert seen["history_to_frame"].any()


def test_a_sample_brighter_than_all_of_the_history_around_is_beyond_it() -> None:
    g = gathered()
    dark = g.warped._replace(rounded=torch.full_like(g.warped.color, 0.01))
    seen = pixel_inputs(g._replace(warped=dark))
    torch.testing.assert_close(seen["beyond_range"], (seen["sample"] - 0.1).abs(), atol=1e-6, rtol=0.0)
    assert not seen["history_contrast"].any()


def test_the_mean_around_tells_a_change_of_light_from_aliasing() -> None:
    g = gathered()
    seen = pixel_inputs(g)
    even = torch.full_like(seen["history"], 0.3)
    checks = (g.grid.x.pixel + g.grid.y.pixel[:, None]) % 2 * 0.2 - 0.1
    light = neighbourhood_inputs({"history": even + 0.1, "frame": even}, DISPLAY)
    aliased = neighbourhood_inputs({"history": even + checks, "frame": even}, DISPLAY)
    torch.testing.assert_close(light["mean_abs_difference"], aliased["mean_abs_difference"])
    inner = (..., slice(-8), slice(-8))  # the last pixels of an odd row are repeated
    assert (light["mean_difference"][inner] > 10.0 * aliased["mean_difference"][inner]).all()


@pytest.mark.parametrize(("across", "down", "blur"), [(0.0, 0.0, 0.0), (0.5, 0.0, 0.5), (0.5, 0.5, 1.0)])
def test_the_history_is_blurred_most_where_it_is_read_between_pixels(
    across: float, down: float, blur: float
) -> None:
    g = gathered()
    position = torch.zeros_like(g.reprojection.position) + torch.tensor([4.0 + across, 7.0 + down])
    seen = pixel_inputs(g._replace(reprojection=g.reprojection._replace(position=position)))["blur"]
    torch.testing.assert_close(seen, torch.full_like(seen, blur))


@pytest.mark.parametrize(
    ("code", "of_one", "of_64"), [("saturating", 0.2, 64 / 68), ("logarithm", 0.166, 1.0)]
)
def test_counts_are_encoded_from_0_without_samples_towards_1(
    code: CountCode, of_one: float, of_64: float
) -> None:
    encoded = COUNTS[code](torch.tensor([0.0, 1.0, 64.0]))
    assert encoded.tolist() == pytest.approx([0.0, of_one, of_64], abs=1e-3)
