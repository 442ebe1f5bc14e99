"""Tests of `import_blender`: signs, units and order of the imported frames."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

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
from supersampler.cli import app
from supersampler.io.images import read_exr, read_exr_metadata, write_exr
from supersampler.io.shot import Shot, copy_shot, import_blender


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


def test_passes_that_can_be_blended_and_metadata_stay_with_a_copy_and_its_results(tmp_path: Path) -> None:
    names = ["A", "DiffDir.R", "DiffDir.G", "DiffDir.B", "Mist.Z", "Sparks.R", "Sparks.G", "Sparks.B"]
    write_blender(tmp_path / "renders", "V")
    for index, path in enumerate(sorted((tmp_path / "renders").glob("*.exr"))):
        extra = [name for name in names if "." in name] + ["CryptoObject00.R", "Noisy Image.R"]
        channels = read_exr(path)
        channels |= {f"V.{name}": channels["V.Combined.R"] * np.float32(0.5) for name in extra}
        write_exr(path, channels, metadata={"Camera": "Main", "Frame": f"{index:02d}"})
    shot = import_blender(tmp_path / "renders")
    ignored = {name.removeprefix("V.") for name in shot.ignored_channels}
    assert ignored == {"CryptoObject00.R", "Noisy Image.R"}
    copied = copy_shot(shot, tmp_path / "shot")
    assert list(copied.info.aov_names) == names
    changed = (tmp_path / "shot" / "shot.json").read_text().replace('"Sparks.B"', '"Sparks.B", "More"')
    (tmp_path / "shot" / "more.json").write_text(changed)
    with pytest.raises(ShotError, match=r"0000\.exr: has 8 AOVs; the shot names 9"):
        Shot.open(tmp_path / "shot" / "more.json").read(0)
    assert copied.read_metadata(1) == shot.read_metadata(1) == {"Camera": "Main", "Frame": "01"}
    for source, out in (
        (tmp_path / "renders", tmp_path / "direct"),
        (tmp_path / "shot", tmp_path / "copied"),
    ):
        command = ["upscale", str(source), "-o", str(out), "--method", "bilinear", "--scale", "2"]
        done = CliRunner().invoke(app, command)
        assert done.exit_code == 0, done.output
        channels = read_exr(out / "kitchen_0009.exr")
        assert channels.keys() == {"R", "G", "B", *names}
        light, color = channels["Sparks.G"].astype(np.float32), channels["R"].astype(np.float32)
        assert light.mean() == pytest.approx(color.mean() * 0.5, rel=0.01)
        metadata = read_exr_metadata(out / "kitchen_0009.exr")
        assert metadata.items() >= {"Camera": "Main", "Frame": "01"}.items()


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


@pytest.mark.parametrize("content", [[], [[0]] * 3, 3, {"a": 1}, ["ab", "cd", "ef"]])
def test_a_jitter_file_of_another_shape_is_refused(tmp_path: Path, content: object) -> None:
    write_blender(tmp_path, "V")
    (tmp_path / "jitter.json").write_text(json.dumps(content))
    with pytest.raises(ShotError, match=r"jitter\.json: holds something else; want \[x, y\] of each frame"):
        import_blender(tmp_path)
    with pytest.raises(ArgumentError, match="jitter is something else; want"):
        import_blender(tmp_path, jitter=[])


def test_a_list_of_jitter_of_another_length_repeats(tmp_path: Path) -> None:
    write_blender(tmp_path, "V")
    pairs = [(0.0, 0.25), (0.125, -0.5)]
    for jitter in (pairs, [*pairs, *pairs, *pairs]):
        shot = import_blender(tmp_path, jitter=jitter)
        assert [shot.read(index).frame.jitter for index in range(COUNT)] == [*pairs, pairs[0]]


def test_blenders_frame_numbers_and_names_are_kept(tmp_path: Path) -> None:
    write_blender(tmp_path / "renders", "V")
    shot = import_blender(tmp_path / "renders")
    assert shot.first_number == 8
    copied = copy_shot(shot, tmp_path / "shot")
    assert copied.first_number == 8
    done = CliRunner().invoke(
        app, ["upscale", str(tmp_path / "shot"), "-o", str(tmp_path / "out"), "--method", "bilinear"]
    )
    assert done.exit_code == 0, done.output
    names = sorted(path.name for path in (tmp_path / "out").glob("*.exr"))
    assert names == ["kitchen_0008.exr", "kitchen_0009.exr", "kitchen_0010.exr"]
