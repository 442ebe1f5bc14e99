"""Tests of `import_blender`: signs, units and order of the imported frames."""

import json
from pathlib import Path

import numpy as np
import pytest

from imported_scene import (
    COUNT,
    CUT,
    DISPLAY_SIZE,
    assert_is_the_scene,
    blender_frame,
    truth,
    write_blender,
)
from supersampler import ArgumentError, ShotError
from supersampler.io.images import write_exr
from supersampler.io.shot import (
    import_blender,
)


@pytest.mark.parametrize(
    ("layer", "names"),
    [
        ("ViewLayer", {}),
        ("RenderLayer", {"depth": "Z"}),
        ("Interior.lights", {"diffuse": "Diffuse Color"}),
    ],
)
def test_blender_frames_come_out_as_ours(tmp_path: Path, layer: str, names: dict[str, str]) -> None:
    write_blender(tmp_path, layer, **names)
    shot = import_blender(tmp_path, cuts=[CUT], reference="reference/*.exr", frame_rate=25)
    assert_is_the_scene(shot)
    assert (shot.name, shot.frame_rate, shot.display_size) == (tmp_path.name, 25.0, DISPLAY_SIZE)
    assert shot.reference_indices == [1]
    item = shot.read(1)
    np.testing.assert_array_equal(item.reference, truth(1))
    gbuffer, aovs = item.frame.gbuffer, item.frame.aovs
    assert gbuffer is not None
    assert aovs is not None
    assert aovs.shape == (36, 64, 1)
    assert (aovs == 0.5).all()
    np.testing.assert_array_equal(gbuffer["normal"][0, 0], [0, 1, 2])
    np.testing.assert_array_equal(gbuffer["base_color"][0, 0], [0, 0.25, 0.5])


def test_of_several_complete_layers_one_must_be_chosen(tmp_path: Path) -> None:
    write_blender(tmp_path, "A", "B")
    with pytest.raises(ArgumentError, match="layer is None; want one of A, B"):
        import_blender(tmp_path)
    with pytest.raises(ArgumentError, match="layer is 'C'; want one of A, B"):
        import_blender(tmp_path, layer="C")
    assert_is_the_scene(import_blender(tmp_path, layer="B", cuts=[CUT]))


def test_a_blender_file_without_motion_says_which_pass_to_turn_on(tmp_path: Path) -> None:
    write_exr(
        tmp_path / "0001.exr", {name: a for name, a in blender_frame(0, "V").items() if "Vector" not in name}
    )
    with pytest.raises(
        ShotError, match=r"0001\.exr: has no layer with all passes; it has V\.Com.*Turn on the passes"
    ):
        import_blender(tmp_path)


def test_without_a_jitter_file_there_is_no_jitter(tmp_path: Path) -> None:
    write_blender(tmp_path, "V")
    (tmp_path / "jitter.json").unlink()
    assert import_blender(tmp_path).read(1).frame.jitter == (0.0, 0.0)
    assert import_blender(tmp_path, jitter=[(0.0, 0.5)] * COUNT).read(1).frame.jitter == (0.0, 0.5)


@pytest.mark.parametrize("content", [[[0, 0]], [[0, 0]] * 4, [[0]] * 3, 3, {"a": 1}, ["ab", "cd", "ef"]])
def test_a_jitter_file_of_another_shape_is_refused(tmp_path: Path, content: object) -> None:
    write_blender(tmp_path, "V")
    (tmp_path / "jitter.json").write_text(json.dumps(content))
    with pytest.raises(ShotError, match=r"jitter\.json: holds .*; want \[x, y\] for each of 3 frames"):
        import_blender(tmp_path)
    with pytest.raises(ArgumentError, match="jitter is 1 pairs; want"):
        import_blender(tmp_path, jitter=[(0, 0)])
