"""Rendered shots: several ratios share references, and rendering resumes after any interruption."""

from pathlib import Path

import numpy as np
import pytest

from gl_scenes import Yard
from supersampler import ArgumentError, halton_jitter
from supersampler.io.shot import Shot, ShotWriter
from supersampler_model.data.rendered import labels_of
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.scenes.scene import Camera, Scene
from supersampler_model.data.sequences import Sequence, SequenceSpec
from supersampler_model.data.shots import ShotForm, render_frame, render_shot, variant_name

DISPLAY = (96, 54)
RATIOS = (1.5, 2.0)
FORM = ShotForm(name="yard", ratios=RATIOS)


class YardSequence(Sequence):
    """Three frames of the renderer's test scene, the last after a cut; the exposure is measured."""

    def __init__(self) -> None:
        self.spec, self.yard = SequenceSpec(family="yard", seed=1, frames=3), Yard(1)
        self.starts = (0, 2)

    def scene(self, index: int) -> Scene:
        return self.yard.scene(index)

    def camera(self, index: int) -> Camera:
        return self.scene(index).camera

    def exposure(self, index: int) -> float | None:
        return None if index == 1 else 1.5


@pytest.fixture(scope="module")
def small_renderer() -> Renderer:
    return Renderer(DISPLAY, samples=16)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, small_renderer: Renderer) -> Path:
    folder = tmp_path_factory.mktemp("yard")
    render_shot(folder, YardSequence(), small_renderer, FORM)
    return folder


def shots(folder: Path) -> dict[float, Shot]:
    return {ratio: Shot.open(folder / f"{variant_name(ratio)}.json") for ratio in RATIOS}


def test_each_ratio_has_its_own_frames_and_all_have_one_reference(
    folder: Path, small_renderer: Renderer
) -> None:
    sizes = {1.5: (64, 36), 2.0: (48, 27)}
    for ratio, shot in shots(folder).items():
        assert (shot.name, shot.render_size, shot.display_size) == ("yard", sizes[ratio], DISPLAY)
        assert shot.reference_indices == [0, 1, 2]
        frames = [shot.read(index).frame for index in range(3)]
        assert [f.jitter for f in frames] == [halton_jitter(index, ratio) for index in range(3)]
        assert [f.reset for f in frames] == [True, False, True]
        assert [f.exposure for f in frames] == [1.5, None, 1.5]
        color, _ = small_renderer.frame(Yard(1).scene(1), sizes[ratio], jitter=frames[1].jitter)
        np.testing.assert_array_equal(frames[1].color, color)
    assert len(list(folder.glob("reference/*.exr"))) == len(list(folder.glob("display/*.exr"))) == 3


def test_stored_frames_are_the_rendered_frames(folder: Path, small_renderer: Renderer) -> None:
    item, drawn = shots(folder)[2.0].read(1), small_renderer.display(Yard(1).scene(1))
    buffers, truth = item.frame.gbuffer_display, small_renderer.reference(Yard(1).scene(1))
    assert buffers is not None
    assert item.reference is not None
    np.testing.assert_array_equal(buffers["depth"], drawn.depth)
    np.testing.assert_array_equal(buffers["normal"], drawn.normal)
    np.testing.assert_allclose(buffers["base_color"], drawn.base_color, atol=0.5 / 255 + 1e-3)
    np.testing.assert_allclose(item.reference, truth.color, rtol=1e-3, atol=1e-6)
    assert item.frame.gbuffer is not None
    assert item.frame.motion.dtype == np.float16
    assert np.abs(item.frame.motion.astype(np.float32)).max() < 20000


def test_references_carry_the_labels_of_their_frame(folder: Path, small_renderer: Renderer) -> None:
    before = None
    for index in range(3):
        now = render_frame(YardSequence(), small_renderer, index, 2.0)
        expected, found = labels_of(now, before), shots(folder)[1.5].read_classes(index)
        assert found is not None
        np.testing.assert_array_equal(found.ghost, expected.ghost)
        np.testing.assert_array_equal(found.alias, expected.alias)
        before = now


def files(folder: Path) -> list[Path]:
    return sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())


class StopError(Exception):
    """A simulated power failure."""


@pytest.mark.parametrize("writes", [1, 2, 3, 4])
def test_a_run_stopped_anywhere_resumes_to_the_same_files(
    tmp_path: Path, folder: Path, small_renderer: Renderer, monkeypatch: pytest.MonkeyPatch, writes: int
) -> None:
    write, left = ShotWriter.write, writes

    def stopping(self: ShotWriter, *arguments: object, **options: object) -> None:
        nonlocal left
        if left == 0:
            raise StopError
        left -= 1
        write(self, *arguments, **options)  # type: ignore[arg-type]  # whatever they are

    monkeypatch.setattr(ShotWriter, "write", stopping)
    with pytest.raises(StopError):
        render_shot(tmp_path, YardSequence(), small_renderer, FORM)
    monkeypatch.undo()
    written: list[int] = []
    render_shot(tmp_path, YardSequence(), small_renderer, FORM, on_frame=lambda: written.append(1))
    assert len(written) == 3 - writes // 2
    assert files(tmp_path) == files(folder)
    for name in files(folder):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes(), name


def test_a_plain_shot_has_one_ratio(tmp_path: Path, small_renderer: Renderer) -> None:
    form = ShotForm(name="yard", ratios=(2.0,), variants=False, gbuffers=False, first_reference=1)
    render_shot(tmp_path, YardSequence(), small_renderer, form)
    shot = Shot.open(tmp_path)
    assert shot.reference_indices == [1, 2]
    first = shot.read(0).frame
    assert (first.gbuffer, first.gbuffer_display) == (None, None)
    with pytest.raises(ArgumentError, match=r"ratios is \(2.0, 3.0\); want .*one, without variants"):
        ShotForm(name="yard", ratios=(2.0, 3.0), variants=False)


def test_a_small_shot_is_rounded_below_visibility(
    tmp_path: Path, folder: Path, small_renderer: Renderer
) -> None:
    form = ShotForm(name="yard", ratios=(2.0,), small=True)
    render_shot(tmp_path, YardSequence(), small_renderer, form)
    small, exact = Shot.open(tmp_path / "2x.json").read(1).frame, shots(folder)[2.0].read(1).frame
    np.testing.assert_array_equal(small.color, exact.color)
    assert not np.array_equal(small.depth, exact.depth)
    np.testing.assert_allclose(small.depth, exact.depth, rtol=2.0**-14)
    np.testing.assert_allclose(
        small.motion.astype(np.float32), exact.motion.astype(np.float32), rtol=2.0**-10, atol=2.0**-9
    )
