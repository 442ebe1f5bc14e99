"""Shots with unshaded frames, through the commands."""

import re
from pathlib import Path

import numpy as np
import pytest

from lit_scene import LitScene
from supersampler import Shot, Upscaler, halton_jitter
from supersampler.io.images import read_exr
from supersampler.io.shot import ShotWriter
from upscale_runs import run, said, succeeded

SIZE, DISPLAY, PATTERN = (64, 36), (128, 72), "suusu"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path, scene = tmp_path_factory.mktemp("shots") / "half", LitScene(velocity=(1.0, 0.3))
    with ShotWriter(path, name="half", display_size=DISPLAY, frame_rate=24) as writer:
        for index, kind in enumerate(PATTERN):
            frame = scene.frame(index, SIZE, halton_jitter(index, 2.0))
            over = {} if kind == "s" else {"color": None}
            writer.write(
                scene.frame(index, SIZE, frame.jitter, **over), reference=scene.truth(index, DISPLAY)
            )
    return path


def test_upscale_renders_the_frames_that_were_not_shaded_and_resumes(folder: Path, tmp_path: Path) -> None:
    out, recording = tmp_path / "out", tmp_path / "a.recording"
    arguments = ("upscale", folder, "--method", "taau", "--extrapolate", "guided-warp", "-o", out)
    done = succeeded(run(*arguments, "--compare", "--record", recording))
    assert "3 were not shaded" in said(done)
    upscaler = Upscaler("taau", display_size=DISPLAY, extrapolation="guided-warp")
    for index, item in enumerate(Shot.open(folder)):
        step = upscaler.step if item.frame.color is not None else upscaler.extrapolate
        written = read_exr(out / f"{index:04d}.exr")
        expected = step(item.frame).astype(np.float16)
        np.testing.assert_array_equal(np.stack([written[c] for c in "RGB"], -1), expected)
    last = (out / "0004.exr").read_bytes()
    (out / "0004.exr").unlink()
    assert run(*arguments).exit_code == 0
    assert (out / "0004.exr").read_bytes() == last
    assert "5 of 5 frames are bit-identical to the recorded ones" in said(run("replay", recording))


def test_an_unshaded_frame_is_named_with_the_option(folder: Path, tmp_path: Path) -> None:
    refused = run("upscale", folder, "--method", "bilinear", "-o", tmp_path)
    assert refused.exit_code == 1
    assert "frame 1: frame.color is None" in said(refused)
    assert "--extrapolate" in said(refused)


def test_results_of_another_extrapolation_are_not_continued(folder: Path, tmp_path: Path) -> None:
    arguments = ("upscale", folder, "--method", "bilinear", "-o", tmp_path)
    assert run(*arguments, "--extrapolate", "guided-warp").exit_code == 0
    assert "extrapolation was" in said(run(*arguments))


def test_extrapolation_models_are_listed_separately_and_do_not_upscale(tmp_path: Path) -> None:
    assert re.search(r"models .*taau .*extrapolation guided-flow, guided-warp", said(run("info")))
    assert "computes the colour of unshaded frames" in said(run("info", "guided-warp"))
    refused = run("upscale", "plaza", "--method", "guided-warp", "-o", tmp_path)
    assert refused.exit_code == 1
    assert "does not upscale" in said(refused)
    refused = run("upscale", "plaza", "--extrapolate", "taau", "-o", tmp_path)
    assert "'taau' upscales" in said(refused)
    assert "gbuffer['base_color'] is None" in said(
        run("upscale", "plaza", "--extrapolate", "guided-warp", "-o", tmp_path)
    )
