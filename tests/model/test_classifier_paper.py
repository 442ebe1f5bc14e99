"""`classifier-paper` with any weights: frame, history and classes."""

import pytest
import torch
from torch import Tensor, nn

from supersampler_model import ops
from supersampler_model.methods.classifier_inputs import Gathered, History
from supersampler_model.methods.classifier_network import class_probabilities
from supersampler_model.methods.classifier_paper import PaperClassifier

RENDER, DISPLAY = ops.Size(16, 8), ops.Size(32, 16)
NONE, VISIBILITY, SHADING = (torch.tensor([9.0 * (i == c) for i in range(3)]) for c in range(3))


@pytest.fixture(scope="module")
def method() -> PaperClassifier:
    torch.manual_seed(0)
    return PaperClassifier().eval()


def assert_close(found: Tensor, expected: Tensor | float, rtol: float = 1e-4) -> None:
    wanted = expected if isinstance(expected, Tensor) else torch.full_like(found, expected)
    torch.testing.assert_close(found, wanted, rtol=rtol, atol=1e-5)


def always(method: PaperClassifier, weight: float) -> None:
    last = method.net.get_submodule("compositor.2")
    assert isinstance(last, nn.Conv2d)
    assert last.bias is not None
    with torch.no_grad():
        last.weight.zero_()
        last.bias.fill_(torch.tensor(weight).logit())


def logits(ghost: Tensor) -> Tensor:
    """Logits of one ghosting class everywhere, without aliasing."""
    each = torch.cat([ghost, NONE])[None, :, None, None]
    return each.expand(1, 6, DISPLAY.height // 2, DISPLAY.width // 2).clone()


def gathered(method: PaperClassifier, *, samples: float = 4.0, depth_before: float = 0.5) -> Gathered:
    """A still frame of one grey on a history of a brighter one."""
    color, past, state, classes, depth, _, exposure = (
        torch.full((1, 3, *RENDER[::-1]), 0.25),
        *method.first_history(DISPLAY, RENDER),
    )
    state[:, :1] = samples
    state[:, 1:4], state[:, 4:7] = 0.1, 0.9
    history = History(past + 0.75, state, classes, depth + depth_before, exposure + 1.0)
    view = ops.View(DISPLAY, RENDER, torch.zeros(1, 2))
    motion = torch.zeros(1, 2, *RENDER[::-1])
    with torch.no_grad():
        return method.gather(color, 0.5 * color[:, :1] / 0.25, motion, torch.ones(1), history, view, view)


@pytest.mark.parametrize("weight", [0.02, 0.3, 0.98])
def test_the_weight_is_of_the_history_and_the_rest_of_the_frame(
    method: PaperClassifier, weight: float
) -> None:
    always(method, weight)
    done = method.finish(gathered(method), logits(NONE), torch.zeros(0))
    before, now = (ops.tone(torch.full_like(done.image, value)) for value in (0.75, 0.25))
    assert_close(ops.tone(done.image), weight * before + (1.0 - weight) * now)
    assert_close(done.weight, weight)


def test_without_samples_the_frame_alone_is_shown(method: PaperClassifier) -> None:
    always(method, 0.9)
    done = method.finish(gathered(method, samples=0.0), logits(NONE), torch.zeros(0))
    assert_close(done.image, 0.25)
    assert not done.weight.any()
    assert (done.state[:, :1] == 1.0).all()


def test_counter_and_range_restart_only_in_disoccluded_pixels(method: PaperClassifier) -> None:
    said = logits(NONE)
    said[..., :4], said[..., 12:] = logits(VISIBILITY)[..., :4], logits(SHADING)[..., 12:]
    state = method.finish(gathered(method), said, torch.zeros(0)).state
    assert (state[:, :1, :, :7] == 1.0).all()
    assert (state[:, :1, :, 9:] == 5.0).all()
    assert_close(state[:, 1:7, :, :7], 0.2)  # 0.25 toned


def test_the_range_of_colours_narrows_towards_the_frame_by_the_contraction(method: PaperClassifier) -> None:
    state = method.finish(gathered(method), logits(NONE), torch.zeros(0)).state
    now, share = 0.2, method.config.contraction  # 0.25 toned
    assert_close(state[:, 1:4], 0.1 + share * 0.1)
    assert_close(state[:, 4:7], 0.9 - share * (0.9 - now))
    assert share > 0.0


def test_the_range_of_colours_grows_to_hold_the_frame(method: PaperClassifier) -> None:
    here = gathered(method)
    narrow = torch.cat([torch.full((1, 3, 16, 32), v) for v in (0.5, 0.6)], dim=1)
    other = here._replace(warped=here.warped._replace(range=narrow))
    assert_close(method.finish(other, logits(NONE), torch.zeros(0)).state[:, 1:4], 0.2)


def test_the_compositor_sees_frame_history_classes_count_and_depth_in_this_order(
    method: PaperClassifier,
) -> None:
    here, shown = gathered(method, depth_before=0.7), []
    handle = method.net.get_submodule("compositor").register_forward_pre_hook(lambda _, x: shown.extend(x))
    said = logits(VISIBILITY)
    method.finish(here, said, torch.zeros(0))
    handle.remove()
    color, past, classes, count, difference = shown[0].split_with_sizes([3, 3, 6, 1, 1], dim=1)
    torch.testing.assert_close(color, here.current.frame)
    torch.testing.assert_close(past, here.warped.color)
    torch.testing.assert_close(classes[:, :3, 4, 4], class_probabilities(said[:, :3])[:, :, 4, 4])
    torch.testing.assert_close(classes[:, 3:, 4, 4], class_probabilities(said[:, 3:])[:, :, 4, 4])
    assert_close(count, 1.0 / 5.0)
    assert_close(difference, 0.2 / 0.7)


@pytest.mark.parametrize(("before", "difference"), [(0.7, 0.2 / 0.7), (0.5, 0.0), (0.4, -0.2)])
def test_depth_difference_is_relative_and_positive_where_the_history_was_closer(
    method: PaperClassifier, before: float, difference: float
) -> None:
    assert_close(gathered(method, depth_before=before).warped.difference, difference)


def test_the_network_sees_the_twenty_buffers_of_section_3(method: PaperClassifier) -> None:
    here = gathered(method, depth_before=0.7)
    packed, half_inputs = method.network_inputs(here)
    planes = torch.nn.functional.pixel_shuffle(packed, 2)
    assert planes.shape == (1, 20, *DISPLAY[::-1])
    assert half_inputs.shape[1] == 0
    expected = [0.2, 0.2, 0.2, 0.5, 0.0, 0.0, 1.0 / 5.0, 0.1, 0.1, 0.1, 0.9, 0.9, 0.9, 0.2 / 0.7, *[0.0] * 6]
    assert_close(planes[0, :, 8, 10], torch.tensor(expected))


def test_counter_and_range_are_read_at_the_nearest_pixel_and_classes_between(method: PaperClassifier) -> None:
    here = gathered(method)
    ramp = torch.arange(32.0).expand(1, 1, 16, 32)
    history = History(
        ramp.expand(1, 3, -1, -1), ramp.expand(1, 7, -1, -1), ramp.expand(1, 6, -1, -1),
        torch.full((1, 2, *RENDER[::-1]), 0.5), torch.ones(1),
    )  # fmt: skip
    motion = torch.zeros(1, 2, 16, 32)
    motion[:, 0] = 0.2  # 0.4 display pixels to the right
    past = ops.reproject(ops.to_display(motion, DISPLAY, RENDER), DISPLAY, here.grid)
    view = ops.View(DISPLAY, RENDER, torch.zeros(1, 2))
    seen = method.gather_history(history, past, past, here.depth, view, torch.ones(1))
    assert float(seen.samples[0, 0, 5, 7]) == 7.0
    assert (seen.range[0, :, 5, 7] == 7.0).all()
    assert_close(seen.classes[0, :, 5, 7], 7.4)
    assert_close(seen.color[0, :, 5, 7], 7.4 / 8.4, rtol=1e-2)


@pytest.mark.parametrize(("motion", "read"), [(0.4, 4.0), (0.6, 5.0), (-0.4, 4.0), (-0.6, 3.0)])
def test_depth_of_the_previous_frame_is_read_at_the_nearest_render_pixel(
    method: PaperClassifier, motion: float, read: float
) -> None:
    rows = torch.arange(1.0, 9.0)[:, None].expand(1, 2, 8, 16)
    _, state, classes, _, _, _ = method.first_history(DISPLAY, RENDER)
    history = History(torch.zeros(1, 3, 16, 32), state, classes, rows, torch.ones(1))
    vectors = torch.zeros(1, 2, 16, 32)
    vectors[:, 1] = motion  # render pixels
    grid = ops.grid_of(DISPLAY, RENDER, torch.zeros(1, 2))
    before = ops.reproject(ops.to_display(vectors, DISPLAY, RENDER), DISPLAY, grid)
    # The display pixel at the centre of render row 3, shifted by half a display pixel.
    before = before._replace(position=before.position + torch.tensor([0.0, 0.5]))
    view = ops.View(DISPLAY, RENDER, torch.zeros(1, 2))
    depth = torch.full((1, 1, 16, 32), 1.0)
    seen = method.gather_history(history, before, before, depth, view, torch.ones(1)).difference
    assert_close(seen[0, 0, 6], (read - 1.0) / read)
