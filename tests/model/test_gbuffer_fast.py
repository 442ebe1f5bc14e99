"""`gbuffer-fast`: light of similar surfaces, textures of the display's own, a history lit anew."""

import numpy as np
import torch
from torch import Tensor, nn

from supersampler.methods.gbuffer_fast.spec import GuidedConfig
from supersampler_model import ops
from supersampler_model.methods import gbuffer_fast
from torch_inputs import plain_inputs, step_by_name

RENDER, DISPLAY = ops.Size(16, 8), ops.Size(32, 16)
VIEW = ops.View(DISPLAY, RENDER, torch.zeros(1, 2))


def plane(size: ops.Size, channels: int, value: float) -> Tensor:
    return torch.full((1, channels, size.height, size.width), value)


def wall(size: ops.Size) -> gbuffer_fast.DisplaySurfaces:
    """A wall, left half nearer and darker; both halves face one way."""
    normal = plane(size, 3, 0.0)
    normal[:, 2] = 1.0
    depth, color = plane(size, 1, 0.1), plane(size, 3, 0.8)
    depth[..., : size.width // 2] = 0.2
    color[..., : size.width // 2] = 0.2
    return gbuffer_fast.DisplaySurfaces(color, normal, depth)


def guided(
    light: Tensor, motion: Tensor | None = None, display: gbuffer_fast.DisplaySurfaces | None = None
) -> gbuffer_fast.GuidedLight:
    motion = plane(RENDER, 2, 0.0) if motion is None else motion
    one, display = plane(RENDER, 1, 1.0), wall(DISPLAY) if display is None else display
    return gbuffer_fast.guide(light, one, motion, wall(RENDER), display, VIEW.grid(RENDER), GuidedConfig())


def test_light_does_not_cross_from_one_surface_to_another() -> None:
    light = plane(RENDER, 3, 0.5)
    light[..., : RENDER.width // 2] = 0.1
    found = guided(light).light
    np.testing.assert_allclose(found[..., : DISPLAY.width // 2], 0.1, atol=1e-4)
    np.testing.assert_allclose(found[..., DISPLAY.width // 2 :], 0.5, atol=1e-4)


def test_each_pixel_moves_as_the_sample_of_its_own_surface() -> None:
    motion = plane(RENDER, 2, 0.0)
    motion[:, 0, :, : RENDER.width // 2] = 3.0
    found = guided(plane(RENDER, 3, 0.5), motion).motion
    assert (found[:, 0, :, : DISPLAY.width // 2] == 3.0).all()
    assert (found[:, :, :, DISPLAY.width // 2 :] == 0.0).all()


def test_agreement_is_near_one_on_a_sampled_surface_and_near_zero_on_one_that_no_sample_hit() -> None:
    assert float(guided(plane(RENDER, 3, 0.5)).agreement.min()) > 0.5
    turned = wall(DISPLAY)._replace(normal=-wall(DISPLAY).normal)
    assert float(guided(plane(RENDER, 3, 0.5), display=turned).agreement.max()) < 1e-3


def test_neighbours_beyond_the_display_are_its_last_pixels() -> None:
    image = torch.arange(6.0).reshape(1, 1, 1, 6).expand(1, 3, 4, 6)
    window = gbuffer_fast.neighbours(image, ops.Size(4, 4))
    assert window.color[0, 0, 5, 0, 3] == 3.0, "right of the last pixel of the display"
    assert window.color[0, 0, 3, 0, 3] == 2.0


def blend_bias(method: gbuffer_fast.GuidedClassifier) -> Tensor:
    """Return the logarithms of the colours' weights, four of each: history, relit, sample, guided, kernel."""
    assert isinstance(method.net.blend, nn.Conv2d)
    assert method.net.blend.bias is not None
    return method.net.blend.bias.data


def step(
    method: gbuffer_fast.GuidedClassifier, base: Tensor, history: list[Tensor]
) -> tuple[Tensor, list[Tensor]]:
    """Step a wall under light of 1 whose display-size base colour is `base`, at rest."""
    render, display = wall(RENDER), wall(DISPLAY)
    display = display._replace(base_color=base, depth=plane(DISPLAY, 1, 0.1))
    least = method.config.min_reflectance
    color = (least + (1.0 - least) * base)[..., ::2, ::2]
    found = {
        **plain_inputs(RENDER),
        "color": color,
        "depth": plane(RENDER, 1, 0.1),
        "motion": plane(RENDER, 2, 0.0),
        "jitter": torch.zeros(1, 2),
        "exposure": torch.ones(1),
        "display_size": torch.tensor(DISPLAY),
        "gbuffer_base_color": base[..., ::2, ::2],
        "gbuffer_normal": render.normal,
        "gbuffer_display_base_color": base,
        "gbuffer_display_normal": display.normal,
        "gbuffer_display_depth": display.depth,
    }
    image, history, _ = step_by_name(method, found, history)
    return image, history


def test_the_first_frame_has_the_textures_of_display_size_g_buffers() -> None:
    method = gbuffer_fast.GuidedClassifier().eval()
    parameters = blend_bias(method)
    parameters[12:16] = 16.0  # the guided colour's weight
    base = 0.2 + 0.6 * torch.rand(1, 3, DISPLAY.height, DISPLAY.width)
    image, _ = step(method, base, method.first_history(DISPLAY, RENDER))
    least = method.config.min_reflectance
    np.testing.assert_allclose(image, least + (1.0 - least) * base, rtol=0.02)


def test_the_history_shows_the_light_of_then_on_the_surfaces_of_now() -> None:
    method = gbuffer_fast.GuidedClassifier().eval()
    parameters = blend_bias(method)
    base = 0.2 + 0.6 * torch.rand(1, 3, DISPLAY.height, DISPLAY.width)
    parameters[12:16] = 16.0
    _, history = step(method, base, method.first_history(DISPLAY, RENDER))
    parameters[12:16], parameters[4:8] = -16.0, 16.0  # the relit history alone
    parameters[8:12] = parameters[16:20] = -16.0
    other = base.flip(3)
    image, _ = step(method, other, history)
    least = method.config.min_reflectance
    np.testing.assert_allclose(image, least + (1.0 - least) * other, rtol=0.05)
