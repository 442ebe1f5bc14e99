"""Render test shots into a cache, in several processes, and frames of test shots for other measurements."""

import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from supersampler import ShotError, halton_jitter
from supersampler.frame import Float32, Frame, Size
from supersampler.io.files import FolderLock, replacing
from supersampler_bench.shots.public_shots import (
    NAME,
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
from supersampler_model.data.sequences import HeldSequence, SequenceSpec, make_sequence
from supersampler_model.data.shots import ShotForm, render_shot, variant_name

HELD_FRAME = 12
"""Frame of a test shot whose camera `held_sequence` keeps."""


def rendered_frame(
    renderer: Renderer,
    scene: Scene,
    size: Size,
    jitter: tuple[float, float],
    *,
    reset: bool = False,
    gbuffers: bool = False,
) -> Frame:
    """Render a frame of a scene, (width, height) `size`, with the camera's exposure.

    With `gbuffers`, the frame also has G-buffers of display size.
    """
    color, surfaces = renderer.frame(scene, size, jitter=jitter)
    display = renderer.display(scene) if gbuffers else None
    return input_frame(color, surfaces, display, jitter=jitter, reset=reset, exposure=scene.camera.exposure)


def rendered_sequence(
    renderer: Renderer, family: str, count: int, size: Size, *, references: int = 0, gbuffers: bool = False
) -> Iterator[tuple[Frame, Float32 | None]]:
    """Render a test shot of `count` frames of (width, height) `size`, with a renderer of display size.

    Yields frames and, for the last `references` ones, their references (H, W, 3). For `gbuffers`, see
    `rendered_frame`.
    """
    sequence = make_sequence(SequenceSpec(family=family, seed=TEST_SHOTS.seeds[family], frames=count))
    for index in range(count):
        scene, jitter = sequence.scene(index), halton_jitter(index, renderer.display_size[0] / size[0])
        frame = rendered_frame(renderer, scene, size, jitter, reset=sequence.cut(index), gbuffers=gbuffers)
        yield frame, renderer.reference(scene).color if index >= count - references else None


def held_sequence(family: str, count: int, *, time_stands: bool) -> HeldSequence:
    """Return a test shot of any length whose camera stays where it is at HELD_FRAME; see `HeldSequence`."""
    spec = SequenceSpec(family=family, seed=TEST_SHOTS.seeds[family], frames=count)
    return HeldSequence(spec, HELD_FRAME, time_stands=time_stands)


def render_test_shots(
    cache: Path, shots: TestShots, *, workers: int = 1, on_frame: Callable[[], None] = lambda: None
) -> None:
    """Render all missing frames into a cache folder; each of some worker processes renders whole shots.

    Raises:
        DataError: a worker failed; complete frames stay, and the next run continues.
        ShotError: another run renders into the cache.
    """
    families = list(shots.seeds)
    parts = [families[k::workers] for k in range(min(workers, len(families)))]
    with FolderLock(cache / NAME) as lock:
        lock.take_new()
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
    """Return the OpenGL device and the version of its driver."""
    with graphics.gl:
        info = graphics.gl.info
    return f"{info['GL_RENDERER']}, OpenGL {info['GL_VERSION']}"


def frames_there(cache: Path, shots: TestShots) -> int:
    """Return the number of frames of all shots that are complete at every ratio."""
    last = variant_name(shots.ratios[-1])
    return sum(len(list((shot_folder(cache, family) / last).glob("[!.]*.exr"))) for family in shots.seeds)


def _render(cache: Path, shots: TestShots, families: list[str], on_frame: OnFrame) -> None:
    """Render some shots in this process."""
    graphics = open_graphics()
    for family in families:
        render_test_shot(cache, shots, family, graphics, on_frame=on_frame)
