"""Render frames of a test shot's sequence as `Upscaler.step` takes them."""

from collections.abc import Iterator

from supersampler import halton_jitter
from supersampler.frame import Float32, Frame, Size
from supersampler_bench.shots.public_shots import TEST_SHOTS
from supersampler_model.data.rendered import frame_of
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.scenes.scene import Scene
from supersampler_model.data.sequences import make_sequence
from supersampler_model.data.specs import SequenceSpec


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
        scene: at the time of this frame.
        size: (width, height), render pixels.
        jitter: (x, y) render pixels, in [-0.5, 0.5].
        reset: whether the frame is the first after a cut.
        gbuffers: whether to render those of display size, too.
    """
    color, surfaces = renderer.frame(scene, size, jitter=jitter)
    display = renderer.display(scene) if gbuffers else None
    return frame_of(color, surfaces, display, jitter=jitter, reset=reset, exposure=scene.camera.exposure)


def rendered_sequence(
    renderer: Renderer, family: str, count: int, size: Size, *, references: int = 0, gbuffers: bool = False
) -> Iterator[tuple[Frame, Float32 | None, float]]:
    """Render a test shot of any length; yield frames, references and exposures of the camera.

    Args:
        renderer: of display size.
        family: of the test shot.
        count: number of frames.
        size: (width, height), render pixels.
        references: number of frames, the last ones, that have a reference (H, W, 3); None for the others.
        gbuffers: whether to render those of display size, too.
    """
    sequence = make_sequence(SequenceSpec(family=family, seed=TEST_SHOTS.seeds[family], frames=count))
    for index in range(count):
        scene, jitter = sequence.scene(index), halton_jitter(index, renderer.display_size[0] / size[0])
        frame = rendered_frame(renderer, scene, size, jitter, reset=sequence.cut(index), gbuffers=gbuffers)
        reference = renderer.reference(scene).color if index >= count - references else None
        yield frame, reference, scene.camera.exposure
