"""Render one frame of a scene as `Upscaler.step` takes it."""

from supersampler.frame import Frame, Size
from supersampler_model.data.rendered import frame_of
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.scenes.scene import Scene


def rendered_frame(
    renderer: Renderer,
    scene: Scene,
    size: Size,
    jitter: tuple[float, float],
    *,
    reset: bool = False,
    gbuffers: bool = False,
) -> Frame:
    """Render a scene at render size, with its camera's exposure.

    Args:
        renderer: of the scene.
        scene: as it is in this frame.
        size: (width, height), render pixels.
        jitter: (x, y) render pixels, in [-0.5, 0.5].
        reset: whether the frame is the first after a cut.
        gbuffers: whether to render those of display size, too.
    """
    color, surfaces = renderer.frame(scene, size, jitter=jitter)
    display = renderer.display(scene) if gbuffers else None
    return frame_of(color, surfaces, display, jitter=jitter, reset=reset, exposure=scene.camera.exposure)
