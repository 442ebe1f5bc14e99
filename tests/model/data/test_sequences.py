"""Sequences are pure functions of their spec, and previous states are those of the previous frame."""

import json
from collections.abc import Iterator
from dataclasses import asdict
from functools import cache

import numpy as np
import pytest

from supersampler_model.data.errors import SceneError
from supersampler_model.data.scenes.scene import Scene
from supersampler_model.data.sequences import (
    APART_FAMILIES,
    TEST_FAMILIES,
    TRAIN_FAMILIES,
    Sequence,
    SequenceSpec,
    make_sequence,
)

FAMILIES = (*TRAIN_FAMILIES, *TEST_FAMILIES, *APART_FAMILIES)
FRAMES = 24


def spec_of(family: str, seed: int = 3, frames: int = FRAMES) -> SequenceSpec:
    return SequenceSpec(family=family, seed=seed, frames=frames)


@cache
def sequence_of(family: str, seed: int = 3) -> Sequence:
    return make_sequence(spec_of(family, seed))


def numbers(scene: Scene) -> Iterator[object]:
    """Everything of a scene that can differ, in order."""
    yield scene.camera, scene.camera_before, scene.sun, scene.spot, scene.points
    yield scene.environment.pixels
    for cloud in scene.particles:
        yield from (cloud.centers, cloud.radii, cloud.colors)
    for thing in scene.instances:
        yield from (thing.model, thing.model_before, thing.palette, thing.palette_before, thing.emission)
        yield from (thing.mesh.positions, thing.mesh.normals, thing.mesh.uv, thing.mesh.indices)
        material = thing.material
        yield material.base_color, material.roughness, material.metallic, material.emissive
        for name in ("base_color", "normal", "orm", "emissive"):
            texture = getattr(material, f"{name}_texture")
            yield None if texture is None else texture.pixels


def equal(one: object, other: object) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other)
    return one == other


@pytest.mark.parametrize("family", FAMILIES)
def test_the_same_spec_gives_the_same_scene_in_any_order(family: str) -> None:
    one = sequence_of(family)
    other = make_sequence(SequenceSpec(**json.loads(json.dumps(asdict(one.spec)))))
    one.scene(17)
    pairs = zip(numbers(one.scene(5)), numbers(other.scene(5)), strict=True)
    assert all(equal(a, b) for a, b in pairs)
    assert [one.cut(i) for i in range(FRAMES)] == [other.cut(i) for i in range(FRAMES)]


@pytest.mark.parametrize("family", FAMILIES)
def test_the_moment_before_is_the_frame_before(family: str) -> None:
    sequence = sequence_of(family)
    before = sequence.scene(0)
    assert before.camera_before == before.camera
    for index in range(1, FRAMES):
        scene = sequence.scene(index)
        assert scene.camera_before == (scene.camera if sequence.cut(index) else before.camera)
        for now, then in zip(scene.instances, before.instances, strict=True):
            assert now.mesh is then.mesh
            assert now.material is then.material
            np.testing.assert_array_equal(now.model_before, then.model)
            assert equal(now.palette_before, then.palette)
        before = scene


@pytest.mark.parametrize("family", FAMILIES)
def test_seeds_differ(family: str) -> None:
    one, other = (sequence_of(family, seed).scene(0) for seed in (3, 4))
    assert one.camera != other.camera
    assert not np.array_equal(one.environment.pixels, other.environment.pixels)
    assert one.points != other.points


def test_some_sequences_have_cuts_and_cuts_move_the_camera() -> None:
    seen = 0
    for seed in range(12):
        sequence = sequence_of("floors", seed)
        cuts = [index for index in range(FRAMES) if sequence.cut(index)]
        assert cuts[0] == 0
        for index in cuts[1:]:
            here, there = (np.array(sequence.scene(i).camera.position) for i in (index, index - 1))
            assert np.linalg.norm(here - there) > 0.5
            seen += 1
    assert 0 < seen < 24


def test_some_exposures_change_and_some_are_left_to_be_measured() -> None:
    ranges, measured = [], 0
    for seed in range(12):
        sequence = sequence_of("floors", seed)
        given = [sequence.exposure(index) for index in (0, FRAMES - 1)]
        cameras = [sequence.scene(index).camera.exposure for index in (0, FRAMES - 1)]
        assert given in ([None, None], cameras)
        measured += given[0] is None
        ranges.append(max(cameras) / min(cameras))
    assert 0 < measured < 12
    assert min(ranges) == pytest.approx(1.0)
    assert 1.3 < max(ranges) < 3.0


def test_families_for_tests_are_no_families_to_learn_from() -> None:
    assert len({*TRAIN_FAMILIES, *TEST_FAMILIES, *APART_FAMILIES}) == len(FAMILIES)
    assert len(TRAIN_FAMILIES) >= 6
    assert len(TEST_FAMILIES) >= 5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"family": "moon"}, r"spec\.family is 'moon'; want one of fences, "),
        ({"seed": -1}, r"spec\.seed is -1; want"),
        ({"frames": 0}, r"spec\.frames is 0; want"),
        ({"frame_rate": 0.0}, r"spec\.frame_rate is 0\.0; want"),
    ],
)
def test_a_bad_spec_is_named(change: dict[str, object], message: str) -> None:
    content = {"family": "floors", "seed": 1, "frames": 4, "frame_rate": 30.0} | change
    with pytest.raises(SceneError, match=message):
        make_sequence(SequenceSpec(**content))  # type: ignore[arg-type]


@pytest.mark.parametrize("index", [-1, 4])
def test_there_is_no_frame_outside(index: int) -> None:
    with pytest.raises(SceneError, match=r"index is .*; want 0 to 3"):
        make_sequence(spec_of("floors", frames=4)).scene(index)
