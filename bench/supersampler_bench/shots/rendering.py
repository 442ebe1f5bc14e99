"""Render test shots: into a cache, in several processes; single frames for other measurements."""

import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from supersampler import halton_jitter
from supersampler.errors import ShotError
from supersampler.frame import Float32, Frame, Size
from supersampler.io.files import replacing
from supersampler_bench.shots.public_shots import (
    PROVENANCE,
    TEST_SHOTS,
    TestShots,
    read_provenance,
    shot_folder,
)
from supersampler_model.data.processes import OnFrame, run_parts
from supersampler_model.data.rendered import input_frame
from supersampler_model.data.renderer.context import Graphics, open_graphics
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.scenes.scene import Scene
from supersampler_model.data.sequences import SequenceSpec, make_sequence
from supersampler_model.data.shots import ShotForm, render_shot, variant_name


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
        renderer: renderer of the scene.
        scene: scene at the time of this frame.
        size: (width, height), render pixels.
        jitter: (x, y) render pixels, in [-0.5, 0.5].
        reset: whether the frame is the first after a cut.
        gbuffers: whether to render those of display size, too.
    """
    color, surfaces = renderer.frame(scene, size, jitter=jitter)
    display = renderer.display(scene) if gbuffers else None
    return input_frame(color, surfaces, display, jitter=jitter, reset=reset, exposure=scene.camera.exposure)


def rendered_sequence(
    renderer: Renderer, family: str, count: int, size: Size, *, references: int = 0, gbuffers: bool = False
) -> Iterator[tuple[Frame, Float32 | None, float]]:
    """Render a test shot of any length; yield frames, references and exposures of the camera.

    Args:
        renderer: renderer of display size.
        family: family of the test shot.
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


def render_test_shots(
    cache: Path, shots: TestShots, *, workers: int = 1, on_frame: Callable[[], None] = lambda: None
) -> None:
    """Render all missing frames; each worker renders whole shots.

    Args:
        cache: folder that gets the test shots.
        shots: their settings.
        workers: processes; software OpenGL renders with cores / workers threads in each.
        on_frame: called after each frame that was missing.

    Raises:
        DataError: a worker failed; complete frames stay, and the next run continues.
    """
    families = list(shots.seeds)
    parts = [families[k::workers] for k in range(min(workers, len(families)))]
    run_parts([partial(_render, cache, shots, part) for part in parts], on_frame=on_frame)


def render_test_shot(
    cache: Path,
    shots: TestShots,
    family: str,
    graphics: Graphics | None = None,
    *,
    on_frame: Callable[[], None] = lambda: None,
) -> None:
    """Render the missing frames of one shot, at all ratios.

    Raises:
        ShotError: existing frames were rendered by another driver or with other settings; a full disk.
        GraphicsError: there is no OpenGL.
    """
    graphics = graphics or open_graphics()
    folder, facts = shot_folder(cache, family), {**shots.facts(family), "driver": driver_name(graphics)}
    found = read_provenance(folder) or facts
    for name, value in facts.items():
        if found.get(name) != value:
            problem = f"the existing shot has the {name} {found.get(name)}; this run's is {value}"
            raise ShotError(folder, problem, "Delete the folder, or name another cache.")
    with replacing(folder / PROVENANCE) as partial:
        partial.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8", newline="\n")
    spec = SequenceSpec(family=family, seed=shots.seeds[family], frames=shots.frames)
    renderer = Renderer(shots.display_size, samples=shots.samples, graphics=graphics)
    form = ShotForm(
        name=family, ratios=shots.ratios, license="Apache-2.0", thin=shots.thin, truth=shots.truth
    )
    render_shot(folder, make_sequence(spec), renderer, form, on_frame=on_frame)


def driver_name(graphics: Graphics) -> str:
    """Return the device and the version of its driver."""
    with graphics.gl:
        info = graphics.gl.info
    return f"{info['GL_RENDERER']}, OpenGL {info['GL_VERSION']}"


def frames_there(cache: Path, shots: TestShots) -> int:
    """Return how many frames of all shots are complete at every ratio."""
    last = variant_name(shots.ratios[-1])
    return sum(len(list((shot_folder(cache, family) / last).glob("[!.]*.exr"))) for family in shots.seeds)


def _render(cache: Path, shots: TestShots, families: list[str], on_frame: OnFrame) -> None:
    """Render some shots in this process."""
    graphics = open_graphics()
    for family in families:
        render_test_shot(cache, shots, family, graphics, on_frame=on_frame)
