"""Shots with G-buffers through the commands: what a model reads is read, and no more."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import Result

from gbuffer_method import RATIO, WANTED, exported, lit
from noise import noise
from supersampler import Conventions, Shot, ShotError, Upscaler
from supersampler.io.images import read_exr, write_exr
from supersampler.io.shot import ShotWriter, import_channels
from supersampler.methods.gbuffers import GBUFFERS, names_of
from upscale_runs import run

RENDER, DISPLAY, FRAMES = (32, 18), (64, 36), 3


@pytest.fixture(scope="module")
def gbuffer_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported(tmp_path_factory)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A shot with all G-buffers."""
    path = tmp_path_factory.mktemp("shots") / "lit"
    with ShotWriter(path, name="lit", display_size=DISPLAY, frame_rate=24) as writer:
        for seed in range(FRAMES):
            writer.write(lit(seed), reference=np.full((*DISPLAY[::-1], 3), 0.5, np.float16))
    return path


@pytest.fixture
def broken(folder: Path, tmp_path: Path) -> Path:
    """A shot with files of display size whose pixels cannot be read."""
    for file in sorted(folder.rglob("*")):
        if file.is_file():
            copy = tmp_path / "broken" / file.relative_to(folder)
            copy.parent.mkdir(parents=True, exist_ok=True)
            content = file.read_bytes()
            copy.write_bytes(content[: len(content) // 2] if "display" in file.parts else content)
    return tmp_path / "broken"


def said(result: Result) -> str:
    return re.sub(r"[\s│╭╮╰╯─]+", " ", result.output)


def test_upscale_hands_a_shot_s_buffers_to_a_model_that_reads_them(
    folder: Path, gbuffer_model: Path, tmp_path: Path
) -> None:
    arguments = ("upscale", folder, "--model", gbuffer_model, "-o", tmp_path / "out")
    assert run(*arguments, "--record", tmp_path / "a.recording").exit_code == 0
    upscaler = Upscaler(gbuffer_model, display_size=DISPLAY)
    for index, item in enumerate(Shot.open(folder)):
        expected = upscaler.step(item.frame).astype(np.float16)
        written = read_exr(tmp_path / "out" / f"{index:04d}.exr")
        np.testing.assert_array_equal(np.stack([written[c] for c in "RGB"], -1), expected)
    replayed = run("replay", tmp_path / "a.recording", "--model", gbuffer_model)
    assert f"{FRAMES} of {FRAMES} frames are bit-identical to the recorded ones" in said(replayed)


def test_a_shot_without_buffers_of_render_size_is_upscaled_by_those_of_display_size(
    gbuffer_model: Path, tmp_path: Path
) -> None:
    frame = replace(lit(1), gbuffer=None)
    with ShotWriter(tmp_path / "shot", name="shot", display_size=DISPLAY, frame_rate=24) as writer:
        writer.write(frame)
    done = run("upscale", tmp_path / "shot", "--model", gbuffer_model, "-o", tmp_path / "out")
    assert done.exit_code == 0, said(done)
    written = read_exr(tmp_path / "out/0000.exr")
    expected = Upscaler(gbuffer_model, display_size=DISPLAY).step(frame).astype(np.float16)
    np.testing.assert_array_equal(np.stack([written[c] for c in "RGB"], -1), expected)


def test_upscale_does_not_read_what_a_model_does_not_ask_for(
    broken: Path, gbuffer_model: Path, tmp_path: Path
) -> None:
    assert run("upscale", broken, "--method", "bilinear", "-o", tmp_path / "one").exit_code == 0
    refused = run("upscale", broken, "--model", gbuffer_model, "-o", tmp_path / "other")
    assert refused.exit_code == 1
    assert "0000.exr" in said(refused)


def test_upscale_renders_at_the_one_ratio_that_a_model_has(gbuffer_model: Path, tmp_path: Path) -> None:
    with ShotWriter(tmp_path / "shot", name="small", display_size=None, frame_rate=24) as writer:
        writer.write(noise(0))
    arguments = ("upscale", tmp_path / "shot", "--model", gbuffer_model, "-o", tmp_path / "out")
    without = said(run(*arguments))
    assert (
        "frame 0: frame.gbuffer_display['base_color'] is None; want (36, 64, 3). 'demodulated' reads it"
        in without
    )
    refused = said(run(*arguments, "--scale", "3"))
    assert "for a display of (96, 54); want frames of (48, 27) or a display of (64, 36)" in refused


def test_info_and_check_say_which_buffers_there_are(folder: Path, gbuffer_model: Path) -> None:
    model = said(run("info", gbuffer_model))
    assert "G-buffers base_color at render size; base_color, normal at display size" in model
    assert f"ratios only {RATIO:.1f}" in model
    assert "G-buffers none" in said(run("info", "taau"))
    every = (
        "base_color, normal, roughness, metallic, specular at render size; "
        "base_color, normal, roughness, metallic, specular, depth at display size"
    )
    assert f"G-buffers {every}" in said(run("info", folder))
    assert f"G-buffers: {every}" in said(run("check", folder))
    assert "G-buffers: none" in said(run("check", "plaza"))


@pytest.mark.parametrize("names", [(), WANTED, WANTED[:1], ("gbuffer_display_depth", "gbuffer_normal")])
def test_a_shot_reads_the_buffers_that_are_named(folder: Path, names: tuple[str, ...]) -> None:
    whole = list(Shot.open(folder))
    assert all(names_of(item.frame) == [*GBUFFERS] for item in whole)
    for item, all_of_it in zip(Shot.open(folder).frames(gbuffers=names), whole, strict=True):
        assert set(names_of(item.frame)) == set(names)
        for name in names:
            found, expected = (GBUFFERS[name].find(frame) for frame in (item.frame, all_of_it.frame))
            np.testing.assert_array_equal(found, expected)
        np.testing.assert_array_equal(item.frame.depth, all_of_it.frame.depth)
        np.testing.assert_array_equal(item.frame.motion, all_of_it.frame.motion)


def test_files_of_buffers_that_are_not_named_are_not_read(broken: Path) -> None:
    shot = Shot.open(broken)
    assert len(list(shot.frames(gbuffers=WANTED[:1]))) == FRAMES
    with pytest.raises(ShotError, match=r"display/0000\.exr"):
        next(iter(shot))


def test_imported_shots_read_the_buffers_that_are_named(tmp_path: Path) -> None:
    grey = np.full((6, 8), 0.5, np.float32)
    write_exr(tmp_path / "0.exr", dict.fromkeys(("R", "G", "B", "Z", "U", "V"), grey))
    write_exr(tmp_path / "more" / "0.exr", {"rough": grey})
    write_exr(tmp_path / "metal" / "0.exr", {"metal": grey})
    channel_map = {
        "color": ["R", "G", "B"],
        "depth": "Z",
        "motion": ["U", "V"],
        "roughness": "more/*.exr:rough",
        "metallic": "metal/*.exr:metal",
    }
    shot = import_channels(tmp_path, channel_map, conventions=Conventions())
    (item,) = shot.frames(gbuffers=("gbuffer_metallic",))
    assert names_of(item.frame) == ["gbuffer_metallic"]
    assert names_of(shot.read(0).frame) == ["gbuffer_roughness", "gbuffer_metallic"]
