"""Training sets: rendering resumes after any interruption, and files return what was rendered."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, cast

import msgspec
import numpy as np
import pytest
from safetensors.numpy import load_file

from gl_scenes import Yard
from gltf_files import cube, strip
from supersampler import ArgumentError, ShotError, halton_jitter
from supersampler.io.files import FolderLock, write_text
from supersampler_model.data.dataset import rendering
from supersampler_model.data.dataset.overview import frequencies, rows
from supersampler_model.data.dataset.rendering import RenderPlan, plan_sequences, render_sequence
from supersampler_model.data.dataset.storage import (
    Dataset,
    Description,
    Rerendered,
    SequenceEntry,
    create_dataset,
    open_dataset,
    read_training_frame,
    write_rerendered,
)
from supersampler_model.data.errors import DatasetError
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.scenes.scene import Camera, Scene
from supersampler_model.data.sequences import APART_FAMILIES, TEST_FAMILIES, TRAIN_FAMILIES, SequenceSpec
from supersampler_model.data.shots import render_frame

DISPLAY = (96, 54)
FRAMES = 3


class YardSequence:
    """The renderer's test scene, with a cut before the last frame, and an exposure that rises."""

    def __init__(self, spec: SequenceSpec) -> None:
        self.spec, self.yard = spec, Yard(spec.seed)

    def scene(self, index: int) -> Scene:
        scene = self.yard.scene(index)
        exposure = 1.0 + 0.5 * index
        camera = replace(scene.camera, exposure=exposure)
        before: Camera = camera if self.cut(index) else replace(scene.camera_before, exposure=exposure)
        return replace(scene, camera=camera, camera_before=before)

    def cut(self, index: int) -> bool:
        return index in (0, FRAMES - 1)


@pytest.fixture(scope="session")
def small_renderer() -> Renderer:
    return Renderer(DISPLAY, samples=16)


@pytest.fixture(autouse=True)
def _yard(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rendering, "make_sequence", YardSequence)


def description(*, gbuffers: bool = False) -> Description:
    spec = SequenceSpec(family="yard", seed=1, frames=FRAMES, frame_rate=30.0)
    entry = SequenceEntry(spec=spec, ratio=2.0, split="train")
    return Description(display_size=DISPLAY, samples=16, gbuffers=gbuffers, seed=0, sequences=(entry,))


def rendered(folder: Path, renderer: Renderer, *, gbuffers: bool = False) -> tuple[Dataset, SequenceEntry]:
    dataset = create_dataset(folder, description(gbuffers=gbuffers))
    [entry] = dataset.entries()
    render_sequence(dataset, entry, renderer)
    return dataset, entry


def test_rendered_frames_are_read_back(tmp_path: Path, small_renderer: Renderer) -> None:
    dataset, entry = rendered(tmp_path, small_renderer)
    frames = list(dataset.frames(entry))
    assert [f.reset for f in frames] == [True, False, True]
    assert [f.exposure for f in frames] == [1.0, 1.5, 2.0]
    again = render_frame(cast(Any, YardSequence(entry.spec)), small_renderer, 1, 2.0)
    np.testing.assert_array_equal(frames[1].color, again.color)
    np.testing.assert_array_equal(load_file(dataset.path(entry, 1))["color"], again.color)
    np.testing.assert_array_equal(frames[1].depth, again.render.depth)
    np.testing.assert_allclose(frames[1].motion, again.render.motion, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(frames[1].reference, again.reference.color, rtol=1e-3, atol=1e-4)


def test_sequences_rendered_at_another_ratio_share_what_is_of_display_size(
    tmp_path: Path, small_renderer: Renderer
) -> None:
    dataset, entry = rendered(tmp_path, small_renderer, gbuffers=True)
    at = dataset.at(4.0)
    [fourth] = at.entries()
    assert at.complete(fourth) == 0
    render_sequence(at, fourth, small_renderer)
    assert (at.complete(fourth), dataset.complete(entry)) == (FRAMES, FRAMES)
    frame, own = at.read(fourth, 1), dataset.read(entry, 1)
    np.testing.assert_array_equal(frame.reference, own.reference)
    again = render_frame(cast(Any, YardSequence(entry.spec)), small_renderer, 1, 4.0)
    np.testing.assert_array_equal(frame.color, again.color)
    assert frame.jitter == halton_jitter(1, 4.0)
    assert own.gbuffer is None
    assert frame.gbuffer is not None
    np.testing.assert_allclose(frame.gbuffer["base_color"] / 255.0, again.render.base_color, atol=0.003)
    assert frame.frame().gbuffer_display is not None
    damaged = Rerendered(frame.color, frame.depth, frame.motion[1:], frame.jitter, frame.gbuffer)
    write_rerendered(at.rerendered_path(fourth, 1), damaged)
    with pytest.raises(DatasetError, match=r"0001\.4x\.safetensors: not a whole training frame .*motion is"):
        at.read(fourth, 1)


def test_another_ratio_is_not_rendered_for_scenes_that_have_changed(
    tmp_path: Path, small_renderer: Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset, _ = rendered(tmp_path, small_renderer)
    at = dataset.at(4.0)
    monkeypatch.setattr(YardSequence, "scene", lambda _, index: Yard(2).scene(index + 20))
    with pytest.raises(DatasetError, match="differs from its rendering now"):
        render_sequence(at, at.entries()[0], small_renderer)
    assert at.complete(at.entries()[0]) == 0


def test_a_cut_is_visibility_ghosting_everywhere_and_the_frame_between_is_not(
    tmp_path: Path, small_renderer: Renderer
) -> None:
    dataset, entry = rendered(tmp_path, small_renderer)
    first, between, last = dataset.frames(entry)
    assert (first.ghost == 1).all()
    assert (last.ghost == 1).all()
    assert 0 < (between.ghost == 1).mean() < 0.5
    assert (between.ghost == 2).mean() < 0.1, "its exposure has risen, its light has not"
    assert (between.alias > 0).any()
    fraction = frequencies(dataset, [entry])["visibility"]  # cuts do not count
    assert fraction == pytest.approx((between.ghost == 1).mean())


def test_a_stopped_run_goes_on_with_the_same_images(tmp_path: Path, small_renderer: Renderer) -> None:
    whole, entry = rendered(tmp_path / "whole", small_renderer)
    dataset = create_dataset(tmp_path / "stopped", description())

    def stop() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_sequence(dataset, entry, small_renderer, on_frame=stop)
    assert dataset.complete(entry) == 1
    again = create_dataset(tmp_path / "stopped", description())
    render_sequence(again, entry, small_renderer)
    paths = [again.path(entry, index) for index in range(FRAMES)]
    assert [whole.path(entry, index).read_bytes() for index in range(FRAMES)] == [
        p.read_bytes() for p in paths
    ]
    times = [path.stat().st_mtime_ns for path in paths]
    render_sequence(again, entry, small_renderer)
    assert [path.stat().st_mtime_ns for path in paths] == times  # a complete sequence is left alone


def test_two_runs_do_not_render_into_one_set_at_once(tmp_path: Path) -> None:
    dataset = create_dataset(tmp_path, description())
    with FolderLock(tmp_path), pytest.raises(ShotError, match="another run writes to it"):
        rendering.render_dataset(dataset)


def test_of_two_runs_that_begin_a_set_at_once_one_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def other_begins(path: Path, text: str) -> None:
        with pytest.raises(ShotError, match="another run writes to it"):
            create_dataset(tmp_path / "set", description(gbuffers=True))
        write_text(path, text)

    monkeypatch.setattr("supersampler_model.data.dataset.storage.write_text", other_begins)
    create_dataset(tmp_path / "set", description())
    assert open_dataset(tmp_path / "set").description == description()


def test_a_full_disk_leaves_whole_frames_only(
    tmp_path: Path, small_renderer: Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset = create_dataset(tmp_path, description())
    [entry] = dataset.entries()
    render_sequence(dataset, entry, small_renderer)
    dataset.path(entry, 1).unlink()

    def refuse(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(OSError, match="No space"):
        render_sequence(dataset, entry, small_renderer)
    assert dataset.complete(entry) == 1
    assert not list((tmp_path / entry.folder).glob("*partial*"))


def test_foreign_folders_are_not_taken_for_rendered_frames(tmp_path: Path) -> None:
    [entry] = description().sequences
    (tmp_path / entry.folder).mkdir(parents=True)
    (tmp_path / entry.folder / "0000.safetensors").write_bytes(b"mine")
    with pytest.raises(DatasetError, match=r"yard-1: already exists, and no dataset\.json lists it"):
        create_dataset(tmp_path, description())
    assert not (tmp_path / "dataset.json").exists()


def test_damaged_files_are_named(tmp_path: Path, small_renderer: Renderer) -> None:
    with pytest.raises(DatasetError, match=r"dataset.json: is not there"):
        open_dataset(tmp_path)
    dataset, entry = rendered(tmp_path, small_renderer)
    path = dataset.path(entry, 0)
    path.write_bytes(path.read_bytes()[:-10])
    with pytest.raises(DatasetError, match=r"0000\.safetensors: not a whole training frame"):
        read_training_frame(path)
    (tmp_path / "dataset.json").write_text("{}")
    with pytest.raises(DatasetError, match="missing required field `version`"):
        open_dataset(tmp_path)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"ratio": 0.5}, r"ratio is 0\.5; want a finite number >= 1"),
        ({"spec": {"family": "../away", "seed": 1, "frames": FRAMES}}, r"spec\.family is '\.\./away'"),
    ],
)
def test_a_description_of_impossible_sequences_is_refused(
    changes: dict[str, Any], match: str, tmp_path: Path
) -> None:
    path = create_dataset(tmp_path, description()).folder / "dataset.json"
    stored = json.loads(path.read_text())
    stored["sequences"][0] |= changes
    path.write_text(json.dumps(stored))
    with pytest.raises(DatasetError, match=match):
        open_dataset(tmp_path)


def test_frames_of_other_sizes_than_described_are_refused(tmp_path: Path, small_renderer: Renderer) -> None:
    dataset, entry = rendered(tmp_path, small_renderer)
    with pytest.raises(DatasetError, match=r"is \(48, 27\) to \(96, 54\); dataset\.json says \(32, 18\) to"):
        dataset.read(replace(entry, ratio=3.0), 0)
    larger = Dataset(tmp_path, replace(dataset.description, display_size=(192, 108)))
    with pytest.raises(DatasetError, match=r"says \(96, 54\) to \(192, 108\)"):
        larger.read(entry, 0)


def test_info_counts_sequences_frames_and_classes(tmp_path: Path, small_renderer: Renderer) -> None:
    rendered(tmp_path, small_renderer)
    said = rows(tmp_path)
    assert said["sequences"] == "train: 1 sequences, 3 of 3 frames"
    assert said["ratios"] == "2 in 1"
    assert "visibility" in said["classes"]


def test_a_plan_follows_from_its_seed_and_keeps_test_families_apart() -> None:
    plan = RenderPlan(families=(*TRAIN_FAMILIES, *TEST_FAMILIES, *APART_FAMILIES), sequences=150)
    drawn = plan_sequences(plan)
    assert drawn == plan_sequences(plan)
    assert drawn != plan_sequences(replace(plan, seed=1))
    for family in plan.families:
        splits = {e.split for e in drawn.sequences if e.spec.family == family}
        assert splits == ({"train", "validation"} if family in TRAIN_FAMILIES else {"test"})
    assert {e.ratio for e in drawn.sequences} == {1.0, 1.5, 2.0, 3.0, 4.0}
    assert msgspec.convert(asdict(drawn), Description) == drawn


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("families", ("none",)), ("families", ()), ("samples", 3), ("frames", 0), ("ratios", ()),
        ("ratios", (2.0, np.nan)), ("ratios", (np.inf,)), ("ratios", (0.5,)), ("ratios", (720.0,)),
    ],
)  # fmt: skip
def test_an_impossible_plan_is_refused(name: str, value: Any) -> None:
    with pytest.raises(ArgumentError, match=f"^{name} is"):
        plan_sequences(replace(RenderPlan(), **{name: value}))


def test_a_plan_without_files_is_unchanged() -> None:
    drawn = plan_sequences(RenderPlan(sequences=3, seed=1)).sequences
    assert [(e.spec.family, e.spec.seed, e.ratio) for e in drawn] == [
        ("fences", 1016164991, 4.0), ("floors", 1099128569, 1.5), ("metals", 1767258089, 2.0),
    ]  # fmt: skip


def test_a_training_set_without_file_scenes_opens_and_continues(tmp_path: Path) -> None:
    drawn = plan_sequences(RenderPlan(sequences=3))
    content = {"version": 1, **asdict(drawn)}
    for entry in content["sequences"]:
        del entry["spec"]["folder"], entry["spec"]["files"]
    (tmp_path / "dataset.json").write_text(json.dumps(content))
    assert open_dataset(tmp_path).description == drawn
    create_dataset(tmp_path, drawn)


@pytest.fixture
def files(tmp_path: Path) -> Path:
    folder = tmp_path / "files"
    folder.mkdir()
    for index in range(4):
        cube(emissiveFactor=[index, 0.0, 0.0]).save(folder / f"cube{index}.glb")
    return folder


def test_a_fraction_of_the_sequences_is_composed_of_files_and_recorded(files: Path) -> None:
    plan = RenderPlan(sequences=30, gltf=files, gltf_fraction=0.4)
    drawn = plan_sequences(plan)
    assert (
        drawn == plan_sequences(plan) == msgspec.convert(json.loads(json.dumps(asdict(drawn))), Description)
    )
    composed = [e for e in drawn.sequences if e.spec.family == "gltf"]
    assert len(composed) == 12
    assert {e.spec.family for e in drawn.sequences} == {"gltf", *TRAIN_FAMILIES}
    trained, validated = (
        {file for e in composed if e.split == split for file in e.spec.files}
        for split in ("train", "validation")
    )
    assert (len(trained), len(validated), len(trained | validated)) == (3, 1, 4)
    alone = plan_sequences(replace(plan, gltf_fraction=1.0))
    assert {e.spec.family for e in alone.sequences} == {"gltf"}
    with pytest.raises(ArgumentError, match="gltf_fraction is 0"):
        plan_sequences(replace(plan, gltf_fraction=0.0))


def test_files_that_have_changed_since_the_set_was_begun_are_named(files: Path, tmp_path: Path) -> None:
    plan = RenderPlan(sequences=8, gltf=files, gltf_fraction=1.0)
    create_dataset(tmp_path / "set", plan_sequences(plan))
    create_dataset(tmp_path / "set", plan_sequences(plan))
    cube(emissiveFactor=[9.0, 0.0, 0.0]).save(files / "cube2.glb")
    with pytest.raises(
        DatasetError, match=r"changed since the set was started: .*files/cube2\.glb\. Restore"
    ):
        create_dataset(tmp_path / "set", plan_sequences(plan))
    strip().save(files / "strip.glb")
    (files / "cube2.glb").unlink()
    with pytest.raises(DatasetError, match=r"differs in its sequences\. .* the same glTF files"):
        create_dataset(tmp_path / "set", plan_sequences(plan))
