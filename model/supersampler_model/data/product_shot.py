"""The rendered shot that ships with the package: a camera walks across the plaza, without cuts."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.scenes.camera import Camera
from supersampler_model.data.scenes.procedural.paths import drift, vector
from supersampler_model.data.scenes.procedural.plaza import plaza
from supersampler_model.data.sequences import Sequence, SequenceSpec
from supersampler_model.data.shots import ShotForm, render_shot

NAME = "plaza"
DISPLAY_SIZE = (640, 360)
FRAMES = 32
_FORM = ShotForm(
    name=NAME,
    ratios=(2.0,),
    variants=False,
    gbuffers=False,
    small=True,
    first_reference=15,
    license="Apache-2.0",
    compression="zip:9",
    reference_compression="dwab:90",
)


class Plaza(Sequence):
    """The plaza over time, without cuts, at constant exposure."""

    def __init__(self) -> None:
        self.spec = SequenceSpec(family=NAME, seed=1, frames=FRAMES, frame_rate=30.0)
        content, hand = (np.random.default_rng([self.spec.seed, i]) for i in (0, 1))
        self.stage, self._shake = plaza(content), drift(hand, 0.015, 1.3)

    def camera(self, index: int) -> Camera:
        """Walk to the right and ahead, with the eyes on the fountain."""
        t = self.time(index)
        eye = np.array([-1.5 + 2.1 * t, 1.62, 3.0 - 0.6 * t]) + self._shake(t)
        return Camera(
            position=vector(eye), target=(0.1 + 0.4 * t, 1.45, -3.6), fov_y=55.0, exposure=self.stage.exposure
        )


def render_product_shot(folder: Path, *, on_frame: Callable[[], None] = lambda: None) -> None:
    """Render the shipped shot into `folder`, or resume.

    Raises:
        ShotError: writing failed, or the folder holds another shot.
        GraphicsError: there is no OpenGL.
    """
    render_shot(folder, Plaza(), Renderer(DISPLAY_SIZE, samples=64), _FORM, on_frame=on_frame)
