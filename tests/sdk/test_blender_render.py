"""Tests of the shot that `supersampler blender` renders: motion, sky, jitter, and its render.json."""

import importlib.util
import json
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import supersampler
from blender_files import NUMBERS, RECORDED
from blender_motion import camera_motion_of
from supersampler import ShotError
from supersampler.cli import app
from supersampler.io.images import read_exr, write_exr
from supersampler.io.shot import open_source
from supersampler.io.shot.blender import read_render_record
from supersampler.validation import detect_conventions


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return Path(shutil.copytree(RECORDED, tmp_path / "render"))


def test_motion_holds_the_change_of_the_lens_shift_and_the_turn_of_the_sky() -> None:
    shot, record = open_source(RECORDED), read_render_record(RECORDED)
    for index in (1, 2, 3):
        frame, want = shot.read(index).frame, camera_motion_of(shot, record, index)
        wrong = np.abs(frame.motion - want).max(axis=-1)
        assert np.percentile(wrong, 90) < 1e-3  # but the cube that moves
        change = np.subtract(record.frames[index].shift, record.frames[index - 1].shift)
        assert np.abs(change).min() > 0.4
        sky = frame.depth == 0
        assert 0.2 < sky.mean() < 0.8
        assert wrong[sky].max() < 1e-4
        assert np.abs(frame.motion[sky]).max() > 0.3


def test_jitter_numbers_size_and_buffers_are_as_rendered() -> None:
    shot, record = open_source(RECORDED), read_render_record(RECORDED)
    assert (len(shot), shot.first_number) == (4, NUMBERS[0])
    assert (shot.render_size, shot.display_size, shot.frame_rate) == ((48, 32), (96, 64), 24.0)
    frames = [item.frame for item in shot]
    assert [frame.jitter for frame in frames] == list(record.jitter[:4])
    assert [frame.reset for frame in frames] == [True, False, False, False]
    gbuffer = frames[0].gbuffer
    assert gbuffer is not None
    assert set(gbuffer) == {"normal", "base_color"}
    assert frames[0].aovs is not None
    assert shot.read_raw(1, gbuffers=()).gbuffer is None


def test_the_checks_find_the_frames_as_stated() -> None:
    detection = detect_conventions(open_source(RECORDED))
    assert detection.agrees, detection.summary()
    assert detection.jitter.margin > 1.2  # and sure of it
    assert detection.depth.margin > 4


def with_engine(folder: Path, engine: str) -> None:
    path = folder / "render.json"
    path.write_text(path.read_text().replace('"CYCLES"', f'"{engine}"'))


def test_vectors_of_eevee_hold_all_but_their_jitter_is_taken_out(folder: Path) -> None:
    truth, record = open_source(folder).read(2).frame.motion, read_render_record(folder)
    path = folder / "0007.exr"
    channels = read_exr(path)
    now, before = record.jitter[2], record.jitter[1]
    channels["ViewLayer.Vector.X"] = truth[..., 0] + np.float32(now[0] - before[0])
    channels["ViewLayer.Vector.Y"] = -(truth[..., 1] + np.float32(now[1] - before[1]))
    write_exr(path, channels)
    with_engine(folder, "BLENDER_EEVEE_NEXT")
    np.testing.assert_allclose(open_source(folder).read(2).frame.motion, truth, atol=1e-5)


def test_passes_that_can_be_blended_are_aovs_by_their_names(folder: Path) -> None:
    for path in folder.glob("*.exr"):
        channels = read_exr(path)
        color = channels["ViewLayer.Combined.R"]
        extra = ("GlossDir.R", "GlossDir.G", "GlossDir.B", "CryptoObject00.R", "Mist.Z")
        write_exr(path, channels | {f"ViewLayer.{name}": color * 0.5 for name in extra})
    raw = open_source(folder).read_raw(1)
    assert raw.aov_names is not None
    assert sorted(raw.aov_names) == ["A", "GlossDir.B", "GlossDir.G", "GlossDir.R", "Mist.Z"]
    assert raw.aovs is not None
    assert raw.color is not None
    index = list(raw.aov_names).index("GlossDir.G")
    np.testing.assert_array_equal(raw.aovs[..., index], raw.color[..., 0] * 0.5)
    out = folder.parent / "out"
    done = CliRunner().invoke(app, ["upscale", str(folder), "-o", str(out), "--method", "bilinear"])
    assert done.exit_code == 0, done.output
    assert read_exr(out / "0006.exr").keys() == {"R", "G", "B", *raw.aov_names}


def test_without_a_vector_pass_motion_is_the_cameras(folder: Path) -> None:
    record = read_render_record(folder)
    for path in folder.glob("*.exr"):
        write_exr(path, {name: a for name, a in read_exr(path).items() if "Vector" not in name})
    with_engine(folder, "BLENDER_WORKBENCH")
    shot = open_source(folder)
    np.testing.assert_allclose(shot.read(3).frame.motion, camera_motion_of(shot, record, 3), atol=1e-4)


def test_an_engine_that_is_not_supported_is_refused_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "bpy", SimpleNamespace())
    path = Path(supersampler.__file__).parent / "integrations" / "blender" / "render_frames.py"
    spec = importlib.util.spec_from_file_location("render_frames", path)
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    scene = SimpleNamespace(render=SimpleNamespace(engine="LUXCORE"))
    with pytest.raises(
        script.BlenderSceneError, match=r"^engine LUXCORE is not supported; use --engine cycles, .*$"
    ):
        script.set_engine(scene, None, None, None)


def test_a_record_is_read_as_it_was_written(folder: Path) -> None:
    before = read_render_record(folder)
    text = (folder / "render.json").read_text()
    before.write(folder)
    assert (folder / "render.json").read_text() == text


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"version": 2}, "is of version 2; this package reads 1"),
        ({"first": -1}, r"Expected `int` >= 0 - at `\$\.first`, is -1"),
        ({"jitter": []}, r"length >= 1 - at `\$\.jitter`, is \[\]"),
        (
            {"frames": [{"camera": [[1]], "shift": [0, 0]}]},
            r"length 4 - at `\$\.frames\[0\]\.camera\[0\]`",
        ),
        ({"frames": [{"camera": [[0] * 4] * 4, "shift": [0, 0]}]}, "no invertible matrix"),
        ({"frames": [{"camera": np.eye(4).tolist()}]}, "missing required field `shift`"),
        ({"frames": []}, "has no complete frame"),
        ({"scene": {"name": "Scene"}}, r"missing required field `blender` - at `\$\.scene`"),
        ({"scene": None}, "does not describe the scene"),
    ],
)
def test_a_damaged_record_is_refused(folder: Path, change: dict[str, Any], message: str) -> None:
    path = folder / "render.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(ShotError, match=message):
        open_source(folder)
