"""`taau` on smooth surfaces that light moves over, so that their history is wrong in each frame."""

from dataclasses import dataclass

import numpy as np
import pytest
import torch

from supersampler import Frame, halton_jitter
from supersampler.frame import Float32
from supersampler.io.display import display_transform
from supersampler_model import ops
from supersampler_model.data.scenes.analytic import (
    NEAR,
    Mask,
    Scene,
    Surface,
    Values,
    Vector,
    facing,
    grey,
    places,
)
from supersampler_model.methods.taau import Taau
from torch_inputs import plain_inputs

DISPLAY = (128, 72)
STEP = 1.0 / 255.0
"""Of an 8-bit image."""


@dataclass(frozen=True)
class Ball(Scene):
    """A ball in the middle of the screen, before grey, that turns under a light that turns around it.

    `spin` and `turn` are radians a frame, about the vertical axis; `velocity` is of the ball, units a frame.
    """

    spin: float = 0.0
    turn: float = 0.0
    velocity: Vector = (0.0, 0.0)
    gloss: float = 0.0

    RADIUS = 15.0

    def surface(self, index: int, x: Values, y: Values) -> Surface:
        """Return the ball where it is, and grey around it."""
        across, down = self.place(index, x, y)
        near = np.sqrt(np.maximum(1.0 - across**2 - down**2, 0.0))
        normal = np.stack([across, down, near], axis=-1)
        before = np.cos(self.spin) * across - np.sin(self.spin) * near
        motion = np.stack(
            [(before - across) * self.RADIUS - self.velocity[0], 0.0 * y - self.velocity[1]], -1
        )
        on = across**2 + down**2 < 1.0
        color = np.where(on[..., None], grey(self.light(index, normal)), 0.3)
        depth = np.where(on, NEAR, 0.5 * NEAR)
        return Surface(color, depth, np.where(on[..., None], motion, 0.0), depth, facing(x, y), facing(x, y))

    def light(self, index: int, normal: Values) -> Values:
        """Return what a matte surface with a highlight reflects."""
        angle = 0.6 + index * self.turn
        light = np.array([np.sin(angle), 0.4, np.cos(angle)]) / np.hypot(1.0, 0.4)
        half = light + np.array([0.0, 0.0, 1.0])
        half /= np.linalg.norm(half)
        highlight = self.gloss * np.maximum(normal @ half, 0.0) ** 20
        return np.asarray(0.1 + 0.6 * np.maximum(normal @ light, 0.0) + highlight)

    def place(self, index: int, x: Values, y: Values) -> tuple[Values, Values]:
        """Return places in radii from the ball's middle."""
        left, top = 26.0 + index * self.velocity[0], 18.0 + index * self.velocity[1]
        return (x - left) / self.RADIUS, (y - top) / self.RADIUS

    def middle(self, index: int) -> Mask:
        """(H, W), True on the part of the ball that faces the camera."""
        return np.asarray(np.hypot(*self.place(index, *places(DISPLAY))) < 0.6)


def errors(scene: Ball, ratio: float, count: int = 20) -> list[Float32]:
    """Errors of display values on the ball's middle, frame by frame, after eight frames; elsewhere NaN."""
    method, render = Taau().eval(), ops.Size(round(DISPLAY[0] / ratio), round(DISPLAY[1] / ratio))
    history, found = method.first_history(ops.Size(*DISPLAY), render), []
    for index in range(count):
        frame = scene.frame(index, render, halton_jitter(index, ratio))
        with torch.no_grad():
            _, history, _ = method.step(*inputs(frame), *history)
        if index >= 8:
            image = history[0][0].permute(1, 2, 0).numpy()  # at rest the image is a mean of samples
            error = display_transform(image, 1.0) - display_transform(scene.truth(index, DISPLAY, 4), 1.0)
            found.append(np.where(scene.middle(index), error[..., 0], np.nan))
    return found


def inputs(frame: Frame) -> list[torch.Tensor]:
    assert frame.color is not None
    images = {"color": frame.color, "depth": frame.depth[..., None], "motion": frame.motion}
    found = {
        name: torch.from_numpy(np.array(image.transpose(2, 0, 1)))[None] for name, image in images.items()
    }
    found |= {"jitter": torch.tensor([frame.jitter]), "exposure": torch.ones(1)}
    found |= {"display_size": torch.tensor(DISPLAY), **plain_inputs(frame.size)}
    return [found[name] for name in Taau.inputs()]


def grid(error: Float32) -> float:
    """Root mean square of what alternates from pixel to pixel."""
    across = 0.25 * (2.0 * error[:, 1:-1] - error[:, :-2] - error[:, 2:])
    down = 0.25 * (2.0 * error[1:-1] - error[:-2] - error[2:])
    return float(np.sqrt(np.nanmean(across**2) + np.nanmean(down**2)))


@pytest.mark.parametrize("ratio", [2.0, 3.0])
@pytest.mark.parametrize(
    "scene",
    [
        Ball(turn=0.05),
        Ball(spin=0.05, gloss=0.5),
        Ball(spin=0.1, turn=-0.1, velocity=(0.5, 0.1), gloss=0.5),
    ],
    ids=["light turns", "glossy ball turns", "both turn and move"],
)
def test_light_that_moves_over_a_smooth_surface_neither_lags_nor_leaves_a_grid(
    scene: Ball, ratio: float
) -> None:
    found = errors(scene, ratio)
    rms = np.sqrt(np.mean([np.nanmean(error**2) for error in found]))
    assert rms < (1.5 if ratio == 2.0 else 2.5) * STEP
    assert np.mean([grid(error) for error in found]) < (0.8 if ratio == 2.0 else 1.1) * STEP
