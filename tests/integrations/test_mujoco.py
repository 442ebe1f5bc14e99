"""Tests of examples/mujoco_cameras.py with MuJoCo; software OpenGL is enough: `make mujoco` runs them."""

import importlib.util
import os
import sys
from argparse import Namespace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from commands import finished
from native_build import module_of
from supersampler import Frame, Model, Upscaler, halton_jitter
from supersampler.frame import Float32
from supersampler.io.images import read_image

if importlib.util.find_spec("mujoco") is None:
    pytest.skip("mujoco is not installed here", allow_module_level=True)
if sys.platform == "linux":
    os.environ.setdefault("MUJOCO_GL", "egl")
import mujoco

TABLE = 1  # id of the last of the large geoms that stand
SCRIPT = Path(__file__).parents[2] / "examples" / "mujoco_cameras.py"


@pytest.fixture(scope="module")
def example() -> ModuleType:
    return module_of(SCRIPT)


def test_images_are_closer_to_the_reference_than_those_of_msaa(
    example: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = {"cameras": 4, "size": 192, "frames": 33, "model": "classifier", "score_every": 8}
    example.main(Namespace(**options, output=tmp_path))
    lines = dict(line.split(": ") for line in capsys.readouterr().out.splitlines())
    upscaled, nearest = (float(lines[f"PSNR {name}, dB"]) for name in ("upscaled", "nearest"))
    assert upscaled > nearest + 3.0, lines
    wrong, wrong_nearest = (float(lines[f"wrong ids {name}, %"]) for name in ("upscaled", "nearest"))
    assert wrong < 0.7 * wrong_nearest, lines
    picture = read_image(tmp_path / "cameras.png")["G"]
    assert picture.shape == (2 * 192, 4 * 3 * 192)
    assert picture.std() > 0.1


def test_a_short_run_writes_its_image(
    example: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = {"cameras": 1, "size": 64, "frames": 1, "model": "taau", "score_every": 8}
    example.main(Namespace(**options, output=tmp_path))
    names = [line.split(": ")[0] for line in capsys.readouterr().out.splitlines()]
    assert names == ["rendered small", "step_many", "rendered in full"]
    assert (tmp_path / "cameras.png").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--frames", "0"], "--frames is 0; want at least 1\n"),
        (["--size", "65"], "--size is 65; want an even number: half of it is rendered\n"),
    ],
)
def test_no_frames_and_odd_sizes_are_refused(options: list[str], message: str) -> None:
    done = finished(sys.executable, SCRIPT, *options)
    assert (done.returncode, done.stderr.endswith(message)) == (2, True), done.stderr


def test_an_unknown_model_is_refused_in_one_line(tmp_path: Path) -> None:
    options = ["--cameras", "1", "--size", "64", "--frames", "1", "--model", "nope", "-o", str(tmp_path)]
    done = finished(sys.executable, SCRIPT, *options)
    assert (done.returncode, done.stderr.startswith("no model 'nope'")) == (1, True), done.stderr


def test_motion_leads_to_the_same_surface_in_the_previous_frame(example: ModuleType) -> None:
    renderer = example.make_renderer(128, samples=0)
    data = mujoco.MjData(renderer.model)
    view = example.View(1, 4)  # it orbits
    frames = []
    for index in range(3):
        data.ctrl[:] = 1.0, 0.5
        mujoco.mj_step(renderer.model, data, nstep=80)
        frames.append(view.frame(renderer, data, data.time, halton_jitter(index, 2.0)))
    before, frame = frames[-2:]
    wrong = part_of_other_ids(before, frame, frame.motion)
    wrong_still = part_of_other_ids(before, frame, np.zeros_like(frame.motion))
    assert wrong < 0.2, wrong
    assert wrong_still > 0.4, wrong_still


def test_a_site_moves_with_its_body(example: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    falling = '<freejoint/><geom size=".02" contype="0" conaffinity="0"/><site size=".15"/>'
    monkeypatch.setattr(example, "BODIES", f'<body pos="0 0 1">{falling}</body>')
    renderer, view = example.make_renderer(64, samples=0), example.View(0, 1)
    data, centers = mujoco.MjData(renderer.model), []
    for index in range(2):
        mujoco.mj_step(renderer.model, data, nstep=60)
        frame = view.frame(renderer, data, data.time, halton_jitter(index, 2.0))
        camera = view.aim(renderer, data, data.time, (0.0, 0.0))
        centers.append(camera.pixels(data.site_xpos[0] - camera.position, 64))
    motion = frame.motion[frame.ids[..., 1] == mujoco.mjtObj.mjOBJ_SITE]
    assert np.abs(centers[0] - centers[1]).max() > 2.0
    np.testing.assert_allclose(motion.mean(axis=0), centers[0] - centers[1], rtol=0.2, atol=0.1)


def test_each_part_of_a_tendon_has_its_own_motion(
    example: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two parts hang between walls, a falling body between them: at the walls they do not move."""
    ends = '<site name="left" pos="0 -.4 .95"/><site name="right" pos="0 .4 .95"/>'
    ball = (
        '<joint type="slide" axis="0 0 1"/><geom size=".02" contype="0" conaffinity="0"/><site name="ball"/>'
    )
    scene = f"{ends}<body pos='0 0 .9'>{ball}</body></worldbody><tendon><spatial width='.05'>"
    path = "".join(f'<site site="{name}"/>' for name in ("left", "ball", "right"))
    rest = "</spatial></tendon><worldbody>"
    monkeypatch.setattr(example, "BODIES", f"{scene}{path}{rest}")
    renderer, view = example.make_renderer(96, samples=0), example.View(0, 4)
    data = mujoco.MjData(renderer.model)
    for index in range(2):
        data.qpos[2], data.time = -0.1 * index, 0.0
        mujoco.mj_forward(renderer.model, data)
        frame = view.frame(renderer, data, 0.0, halton_jitter(index, 2.0))
    camera = view.aim(renderer, data, 0.0, (0.0, 0.0))
    is_tendon = frame.ids[..., 1] == mujoco.mjtObj.mjOBJ_TENDON
    rows, columns = is_tendon.nonzero()
    for name, moves in (("left", False), ("right", False), ("ball", True)):
        place = camera.pixels(data.site(name).xpos - camera.position, 96)
        near = np.hypot(columns - place[0], rows - place[1]) < 5
        assert near.any()
        length = np.linalg.norm(frame.motion[rows[near], columns[near]], axis=1).mean()
        assert length > 3.0 if moves else length < 1.5, (name, length)


def part_of_other_ids(before: Frame, frame: Frame, motion: Float32) -> float:
    """Return the part of samples of moving bodies that have other ids where this motion leads."""
    assert before.ids is not None
    assert frame.ids is not None
    height, width = frame.depth.shape
    y, x = np.mgrid[:height, :width]
    at = np.rint(np.stack([x, y], -1) + frame.jitter + motion - before.jitter).astype(int)
    inside = ((at >= 0) & (at < (width, height))).all(axis=2)
    moves = (frame.ids[..., 0] > TABLE) & (np.linalg.norm(frame.motion, axis=2) > 1.0) & inside
    columns, rows = at[moves].T
    return float((before.ids[rows, columns] != frame.ids[moves]).any(axis=1).mean())


def test_ids_of_images_are_ids_of_the_simulation(example: ModuleType) -> None:
    renderer = example.make_renderer(96, samples=0)
    data = mujoco.MjData(renderer.model)
    views = [example.View(index, 3) for index in range(3)]
    model = Model.load("taau", threads=1)
    upscalers = [Upscaler(model, display_size=(192, 192)) for _ in range(3)]
    for index in range(4):
        mujoco.mj_step(renderer.model, data, nstep=10)
        frames = [view.frame(renderer, data, data.time, halton_jitter(index, 2.0)) for view in views]
        for frame, result in zip(
            frames, Upscaler.step_many(upscalers, frames, outputs=("ids",)), strict=True
        ):
            there = {tuple(ids) for ids in frame.ids.reshape(-1, 2).tolist()}
            assert result.ids is not None
            assert {tuple(ids) for ids in result.ids.reshape(-1, 2).tolist()} <= there
