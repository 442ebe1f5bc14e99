"""`guided-flow` equals `guided-warp` before training, and moves light on surfaces at rest."""

from collections.abc import Sequence

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from flow_method import Shadow, random_flow
from supersampler import Frame, halton_jitter
from supersampler.frame import Size
from supersampler.methods.extrapolation.spec import GuidedFlowConfig
from supersampler_model import ops
from supersampler_model.data.scenes.analytic import EXTENT, places
from supersampler_model.methods.base import Method
from supersampler_model.methods.guided_flow import Gathered, GuidedFlow, flow_history, halved, motions_of
from supersampler_model.methods.guided_warp import GuidedWarp, surface_of
from torch_inputs import step_by_name, tensors_of

SIZE = (64, 36)
INPUTS = ["color", *GuidedFlow.inputs()]
HISTORY = list(GuidedFlow.history)
SCENE = Shadow(2.0, velocity=(0.7, -0.4))


def tensors(frame: Frame) -> dict[str, Tensor]:
    names = INPUTS if frame.color is not None else GuidedFlow.inputs()
    return tensors_of(frame, SIZE, names)


def run(method: Method, frames: Sequence[dict[str, Tensor]], pattern: str) -> list[Tensor]:
    """Return the images and, at the end, the history; "s" is shaded, "u" is not."""
    history: list[Tensor] | None = None
    images = []
    for frame, kind in zip(frames, pattern, strict=True):
        if kind == "s" or history is None:
            history = method.after_shaded(frame, history)
            continue
        image, history, _ = step_by_name(method, frame, history)
        images.append(image)
    return [*images, *(history or [])]


def gathered(scene: Shadow, pattern: str = "sus") -> Gathered:
    """Gather the frame after these."""
    return gathered_from([tensors(scene.frame(index)) for index in range(len(pattern) + 1)], pattern)


def gathered_from(frames: Sequence[dict[str, Tensor]], pattern: str = "sus") -> Gathered:
    """Gather the last frame; `pattern` is that of the frames before."""
    history = run(GuidedFlow().eval(), frames[:-1], pattern)[-len(HISTORY) :]
    now = frames[-1]
    surface = surface_of(now["gbuffer_base_color"], now["gbuffer_normal"], now["depth"])
    arguments = now["gbuffer_roughness"], now["motion"], now["jitter"], flow_history(*history)
    return GuidedFlow().gather(surface, *arguments)


@pytest.mark.parametrize("pattern", ["su", "susu", "suusuu", "ssuu"])
def test_untrained_it_computes_what_guided_warp_computes(pattern: str) -> None:
    frames = [tensors(SCENE.frame(i, SIZE, halton_jitter(i, 2.0))) for i in range(len(pattern))]
    count = pattern.count("u")
    ours, theirs = (run(method.eval(), frames, pattern)[:count] for method in (GuidedFlow(), GuidedWarp()))
    for one, other in zip(ours, theirs, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-5)


def test_where_nothing_moves_both_images_are_the_same_and_the_frame_is_reproduced() -> None:
    still = gathered(Shadow(0.0))
    torch.testing.assert_close(still.lights.later, still.lights.earlier, rtol=1e-5, atol=1e-6)
    frames = [tensors(Shadow(0.0).frame(i)) for i in range(4)]
    image = run(GuidedFlow().eval(), frames, "susu")[-len(HISTORY) - 1]
    off = (image - frames[3]["color"]).abs()
    assert off.mean() < 0.02  # of the four samples that a pixel is the mean of
    assert off.max() < 0.15


def test_the_network_sees_a_shadow_where_it_was_in_each_frame() -> None:
    later, earlier = (p[0, 0, 9].numpy() for p in gathered(Shadow(3.0)).lights)  # frames 2 and 0, in 3
    middle = 0.5 * (later.min() + later.max())
    edges = [2.0 * np.interp(middle, row, np.arange(len(row))) for row in (later, earlier)]
    assert edges[0] - edges[1] == pytest.approx(6.0, abs=1.0)


def test_a_flow_moves_a_shadow_and_leaves_textures_where_they_are() -> None:
    scene = Shadow(4.0)
    now, truth = gathered(scene), tensors(scene.frame(3))["color"]
    method, said = GuidedFlow(), sure_of(truth)
    stays = method.finish(now, said)
    said[:, 0] = -2.0  # light is read two half-size pixels to the left: it has moved four to the right
    after = method.finish(now, said)
    edge = np.s_[..., 4:-4, 28:44]
    before = (stays - truth)[edge].abs().mean()
    assert (after - truth)[edge].abs().mean() < 0.45 * before
    far = np.s_[..., 4:-4, 50:60]
    assert (after - stays)[far].abs().mean() < 0.2 * (truth.roll(4, dims=3) - truth)[far].abs().mean()


def test_a_gain_brightens_all_channels_alike_within_its_bound() -> None:
    now = gathered(Shadow(0.0))
    said = sure_of(now.light.color)
    plain = GuidedFlow().finish(now, said)
    said[:, 2] = 9.0
    bright = GuidedFlow(GuidedFlowConfig(max_stops=1.0)).finish(now, said)
    torch.testing.assert_close(bright, 2.0 * plain, rtol=1e-4, atol=1e-5)


def test_light_is_taken_as_far_as_the_network_is_sure() -> None:
    now = gathered(Shadow(0.0))
    said = sure_of(now.light.color)
    said[:, 2] = 0.5
    said[:, 3] = torch.tensor([-30.0, 30.0]).repeat(16)
    plain, image = (GuidedFlow().finish(now, s) for s in (0.0 * said, said))
    torch.testing.assert_close(image[..., ::4], plain[..., ::4])
    torch.testing.assert_close(image[..., 2::4], 2.0 * plain[..., 2::4], rtol=1e-4, atol=1e-5)
    middle = 1.5 * plain[..., 1::4]  # between a pixel that is not and one that is
    torch.testing.assert_close(image[..., 1::4], middle, rtol=1e-4, atol=1e-5)


def test_light_does_not_move_from_one_surface_to_another() -> None:
    now = gathered(Shadow(4.0))
    turned = now.surface.normal.clone()
    turned[..., 32:] = torch.tensor([1.0, 0.0, 0.0])[:, None, None]
    said = sure_of(now.light.color)
    said[:, 0] = -2.0
    method = GuidedFlow()
    image = method.finish(now._replace(surface=now.surface._replace(normal=turned)), said)
    kept, moved = (method.finish(now, s) for s in (0.0 * said, said))
    torch.testing.assert_close(image[..., 32:36], kept[..., 32:36], rtol=0.02, atol=0.01)
    for same in (np.s_[..., :32], np.s_[..., 36:]):
        torch.testing.assert_close(image[same], moved[same], rtol=1e-4, atol=1e-5)
    assert (kept - moved)[..., 32:36].abs().max() > 0.3


def sure_of(image: Tensor) -> Tensor:
    """Network outputs that leave all light where it is, with certainty."""
    said = torch.zeros(1, 4, *halved(image).shape[2:])
    said[:, 3] = 30.0
    return said


# --- the history ---


def test_after_a_reset_no_light_has_moved() -> None:
    first = dict(zip(HISTORY, GuidedFlow.after_shaded(tensors(SCENE.frame(0))), strict=True))
    assert not first["shaded_motion"].any()
    assert first["earlier_color"] is first["color"]


@pytest.mark.parametrize("sizes", [(SIZE,) * 5, ((48, 27), (96, 54), (64, 36), (80, 45), (72, 40))])
def test_motion_adds_up_to_that_back_to_both_shaded_frames(sizes: tuple[Size, ...]) -> None:
    """An image is zoomed about the middle, by another factor and with another jitter each frame."""
    factors, frames = (1.0, 0.95, 1.04, 0.93, 1.03), []
    for index, (factor, size) in enumerate(zip(factors, sizes, strict=True)):
        jitter = halton_jitter(index, 2.0)
        frames.append(tensors(SCENE.frame(index, size, jitter, motion=zoomed(size, jitter, factor))))
    history = run(GuidedFlow().eval(), frames[:-1], "susu")[-len(HISTORY) :]
    found = motions_of(frames[4]["motion"], frames[4]["jitter"], flow_history(*history))
    totals = factors[4] * factors[3], factors[4] * factors[3] * factors[2] * factors[1]
    for motion, total in zip(found, totals, strict=True):
        expected = zoomed(sizes[4], halton_jitter(4, 2.0), total)
        inner = np.s_[6:-6, 9:-9]
        got = motion[0].numpy().transpose(1, 2, 0)
        np.testing.assert_allclose(got[inner], expected[inner], atol=4e-4)


def zoomed(size: Size, jitter: tuple[float, float], factor: float) -> NDArray[np.float32]:
    x, y = places(size, jitter)
    away = np.stack([x - EXTENT[0] / 2, y - EXTENT[1] / 2], axis=-1)
    return np.asarray(away * (factor - 1.0) * np.array(size) / EXTENT, np.float32)


def test_without_a_shaded_frame_the_image_is_black() -> None:
    method, frame = random_flow(), tensors(SCENE.frame(1))
    nothing = method.first_history(ops.Size(*SIZE), ops.Size(*SIZE))
    assert step_by_name(method, frame, nothing).image.max() == 0.0


# --- sizes and bad values ---


def test_light_as_bright_and_as_dark_as_there_is_stays_in_the_range_of_halves() -> None:
    method = random_flow()
    for scale in (0.0, 1e-7, 1e4, 6e4):
        frames = [tensors(SCENE.frame(index)) for index in range(4)]
        for frame in frames:
            frame["color"] = (frame["color"] * scale).clamp(max=65504.0)
        seen = gathered_from(frames)
        for light in seen.lights:
            assert 0.0 <= light.min() <= light.max() < 1.0
        with torch.no_grad():
            image = method.finish(seen, method.net(*seen.lights)[0])
        assert 0.0 <= image.min() <= image.max() <= 65504.0


def test_the_image_does_not_depend_on_the_unit_of_light() -> None:
    method = random_flow()
    frames = [tensors(SCENE.frame(index)) for index in range(4)]
    bright = [{**frame, "color": 64.0 * frame["color"]} for frame in frames]
    one, other = (run(method, f, "susu")[1] for f in (frames, bright))
    torch.testing.assert_close(64.0 * one, other, rtol=1e-3, atol=1e-3)
