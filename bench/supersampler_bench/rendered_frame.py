"""A frame of a scene as benches hand it to an `Upscaler`, rendered just now."""

from supersampler.frame import Frame, Size
from supersampler_model.data.gl.renderer import Renderer
from supersampler_model.data.rendered import frame_of
from supersampler_model.data.scene import Scene


def rendered_frame(
    renderer: Renderer, scene: Scene, size: Size, jitter: tuple[float, float], *, reset: bool = False
) -> Frame:
    """Draw a scene at render size, with its camera's exposure; without G-buffers of display size.

    Args:
        renderer: draws it.
        scene: as it is in this frame.
        size: (width, height), render pixels.
        jitter: (x, y) render pixels, in [-0.5, 0.5].
        reset: whether the frame is the first after a cut.
    """
    color, surfaces = renderer.frame(scene, size, jitter=jitter)
    return frame_of(color, surfaces, None, jitter=jitter, reset=reset, exposure=scene.camera.exposure)
