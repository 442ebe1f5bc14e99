"""Unshaded frames through an Upscaler: sources of the extrapolation, and refused frames."""

import json
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from alternating import Frames, extrapolated_by_torch
from apart import run_apart
from flow_method import Shadow
from lit_scene import LitScene
from noise import noise
from shared_models import shared_model
from supersampler import (
    ArgumentError,
    Frame,
    FrameError,
    Model,
    ModelError,
    Shot,
    StepResult,
    Upscaler,
    halton_jitter,
)
from supersampler.arguments import ExecutorName
from supersampler.backends.onnx.executor import OnnxExtrapolation
from supersampler.backends.onnx.runtime import CPU
from supersampler.extrapolation import Extrapolator
from supersampler.frame import Float32
from supersampler.io.images import read_exr
from supersampler.io.shot import ShotWriter
from supersampler.methods import executors
from supersampler.methods.model_file import extrapolation_names, find_model, model_names
from supersampler.methods.model_info import ModelInfo
from supersampler.recording import open_recording
from supersampler.recording.replay import Replay
from supersampler_bench.specs import with_default_gbuffers
from supersampler_bench.stress.scenes import still
from supersampler_model.methods.base import load_trained, shipped_weights
from supersampler_model.methods.guided_flow import GuidedFlow
from supersampler_model.methods.guided_warp import GuidedWarp
from upscale_runs import run as cli
from upscale_runs import said, succeeded

SIZE, DISPLAY = (64, 36), (128, 72)
SCENE = LitScene(velocity=(1.3, -0.6), radius=7.0, disc_velocity=(2.5, 0.5), sky=5.0)
shaded = Frames(SCENE, SIZE)
unshaded, run = shaded.unshaded, shaded.run


@pytest.fixture(scope="module")
def taau() -> Model:
    return shared_model("taau", "onnx")


def make(model: Model, **options: Any) -> Upscaler:
    settings = {"display_size": DISPLAY, "extrapolation": "guided-warp", "validate": "off"}
    return Upscaler(model, **{**settings, **options})


@pytest.mark.parametrize("pattern", ["susu", "suusuuus", "ssuuu"])
def test_the_method_steps_on_the_extrapolated_colour(taau: Model, pattern: str) -> None:
    images, plain = run(make(taau), pattern), Upscaler(taau, display_size=DISPLAY, validate="off")
    colors = extrapolated_by_torch(GuidedWarp(), shaded, pattern)
    for index, (image, color) in enumerate(zip(images, colors, strict=True)):
        frame = shaded(index) if color is None else shaded(index, color=np.ascontiguousarray(color))
        off = np.abs(plain.step(frame) - image)
        assert off.mean() < 1e-5  # of torch and ONNX Runtime
        assert np.quantile(off, 0.99) < 1e-4


def test_an_extrapolated_frame_is_nearly_what_a_shaded_one_would_be(taau: Model) -> None:
    every, half = run(make(taau), "s" * 12), run(make(taau), "su" * 6)
    truth = [SCENE.truth(index, DISPLAY) for index in range(12)]
    errors = [
        np.mean([np.abs(i[index] - truth[index]).mean() for index in (5, 7, 9, 11)]) for i in (every, half)
    ]
    assert errors[1] < 1.3 * errors[0]


@pytest.mark.parametrize("between", [0, 1], ids=["next", "second"])
@pytest.mark.parametrize(
    ("extrapolation", "executor"), [("guided-warp", "cpu"), ("guided-warp", "onnx"), ("guided-flow", "onnx")]
)
def test_where_the_last_shaded_frame_lacks_a_region_the_history_is_shown(
    extrapolation: str, executor: ExecutorName, between: int
) -> None:
    # grey in grey: all images are of one colour, also beside the region
    still = Frames(LitScene(velocity=(0.0, 0.0), disc_velocity=(0.0, 0.0)), SIZE)
    upscaler = make(shared_model("taau", executor), extrapolation=extrapolation)

    def grey(index: int) -> Frame:
        frame, color = still(index), np.full((*SIZE[::-1], 3), 0.5, np.float32)
        assert frame.gbuffer is not None
        buffers = {**frame.gbuffer, "base_color": color, "roughness": color[..., 0]}
        return replace(frame, color=color, gbuffer=buffers)

    for index in range(8):
        upscaler.step(grey(index))
    color = np.full((*SIZE[::-1], 3), 0.5, np.float32)
    color[4:30, 10:40] = np.nan  # wider than the samples around a pixel that are read
    upscaler.step(replace(grey(8), color=color))
    for index in range(between + 1):
        image = upscaler.extrapolate(replace(grey(9 + index), color=None))
    np.testing.assert_allclose(image, 0.5, atol=0.01)


def test_the_render_size_may_change_between_frames(taau: Model) -> None:
    upscaler = make(taau)
    for index, size in enumerate([(64, 36), (48, 27), (80, 45)]):
        frame = shaded(index, size, color=None) if index else shaded(0)
        image = upscaler.extrapolate(frame) if index else upscaler.step(frame)
        assert image.shape == (72, 128, 3)
        assert np.abs(image - SCENE.truth(index, DISPLAY)).mean() < 0.2


def test_maps_and_an_array_to_write_to_are_as_of_any_step(taau: Model) -> None:
    upscaler, out = make(taau), np.empty((72, 128, 3), np.float32)
    upscaler.step(shaded(0))
    result: Any = upscaler.extrapolate(unshaded(1), out=out, outputs=("weight",))
    assert isinstance(result, StepResult)
    assert result.image is out


# --- what is refused ---


def test_an_upscaler_without_extrapolation_says_how_to_make_one_with_it(taau: Model) -> None:
    upscaler = make(taau, extrapolation=None)
    upscaler.step(noise(1, SIZE))  # needs no G-buffers
    with pytest.raises(ArgumentError, match=r"extrapolation is None; want a model.*'guided-warp'"):
        upscaler.extrapolate(unshaded(1))


def test_calls_that_extrapolation_would_not_see_are_refused(taau: Model) -> None:
    upscaler = make(taau)
    for call in (
        lambda: upscaler.step_tensors({}, jitter=(0.0, 0.0)),
        lambda: upscaler.step_computed(unshaded(1), np.ones((36, 64, 3), np.float32)),
    ):
        with pytest.raises(ArgumentError, match="called with extrapolation"):
            call()


def test_extrapolation_models_and_upscaling_models_are_not_interchangeable(taau: Model) -> None:
    assert extrapolation_names() == ["guided-flow", "guided-warp"]
    assert not set(extrapolation_names()) & set(model_names())
    for use in (
        Model.load,
        lambda name: Upscaler(name, scale=2.0),
        lambda n: Upscaler.plan(SIZE, DISPLAY, n),
    ):
        with pytest.raises(ModelError, match=r"does not upscale.*Upscaler\(extrapolation='guided-warp'\)"):
            use("guided-warp")
    with pytest.raises(ModelError, match=r"'taau' upscales.*extrapolation takes guided-flow or guided-warp"):
        make(taau, extrapolation="taau")
    with pytest.raises(ModelError, match=r"no model 'guided-wrap'.*guided-warp"):
        make(taau, extrapolation="guided-wrap")


# --- sessions ---


def test_a_state_goes_with_and_without_extrapolation(taau: Model) -> None:
    with_it, without_it = make(taau), make(taau, extrapolation=None)
    run(with_it, "su")
    without_it.load_state(with_it.save_state())
    np.testing.assert_array_equal(without_it.step(shaded(2)), with_it.step(shaded(2)))
    with_it.load_state(without_it.save_state())
    with pytest.raises(FrameError, match="before any shaded frame"):
        with_it.extrapolate(unshaded(3))
    np.testing.assert_array_equal(without_it.step(shaded(3)), with_it.step(shaded(3)))


def test_stats_tell_extrapolated_frames_from_shaded_ones(taau: Model) -> None:
    upscaler = make(taau)
    run(upscaler, "suusu")
    stats = upscaler.stats
    assert (stats.frames, stats.extrapolated, stats.resets) == (5, 3, 1)
    assert stats.extrapolation_seconds > 0.0
    assert stats.seconds > 0.0


def test_correct_shaded_and_unshaded_frames_pass_the_checks() -> None:
    scene = LitScene(velocity=(2.0, 1.0), radius=8.0, disc_velocity=(-1.0, 0.5), sky=6.0)
    upscaler = make(shared_model("bilinear"), validate="strict", display_size=(256, 144))
    for index, kind in enumerate("ssuusususs"):
        frame = scene.frame(index, (128, 72), halton_jitter(index, 2.0))
        upscaler.step(frame) if kind == "s" else upscaler.extrapolate(replace(frame, color=None))


def test_checks_read_the_buffers_that_extrapolation_reads(taau: Model) -> None:
    upscaler = make(taau, validate="strict")
    upscaler.step(shaded(0))
    wrong = {**(shaded(1).gbuffer or {}), "base_color": np.full((36, 64, 3), 7.5, np.float32)}
    with pytest.raises(FrameError, match=r"gbuffer\['base_color'\] is outside"):
        upscaler.extrapolate(unshaded(1, gbuffer=wrong))


# --- recordings ---


def test_a_replay_with_another_extrapolation_says_so(taau: Model, tmp_path: Path) -> None:
    file = tmp_path / "a.recording"
    with make(taau, record=file) as upscaler:
        run(upscaler, "su")
    setup = json.loads((file / "recording.json").read_text())
    setup["extrapolation"]["folder"] = "mine"
    (file / "recording.json").write_text(json.dumps(setup))
    with pytest.raises(OSError, match=r"model 'mine' \(guided-warp\), which does not ship.*--extrapolate"):
        Replay(open_recording(file))
    assert Replay(open_recording(file), extrapolation="guided-warp").is_recorded_model
    with make(taau, record=tmp_path / "plain", extrapolation=None) as upscaler:
        upscaler.step(noise(1, SIZE))
    plain = open_recording(tmp_path / "plain")
    assert not Replay(plain, extrapolation="guided-warp").is_recorded_model


_LARGE = """
import resource
import numpy as np
from supersampler import Frame
from supersampler.extrapolation import Extrapolator
h, w = 540, 960
ones = np.full((h, w, 3), 0.5, np.float32)
frame = dict(depth=ones[..., 0], motion=ones[..., :2], jitter=(0.0, 0.0),
             gbuffer={"base_color": ones, "normal": ones})
model = Extrapolator("guided-warp", ["CPUExecutionProvider"], 1)
past = model.after_shaded(Frame(color=ones, **frame))
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
color, _ = model.extrapolate(Frame(color=None, **frame), past)
assert np.allclose(color, 0.5, rtol=1e-4)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="counts in kilobytes")
def test_a_frame_of_960x540_takes_less_than_a_gigabyte() -> None:
    assert int(run_apart(_LARGE).stdout) < 800_000


def test_upscalers_share_the_graph_of_an_extrapolation(taau: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []

    def counted(info: ModelInfo, *given: Any) -> Any:
        opened.append(info.method)
        return OnnxExtrapolation(info, *given)

    monkeypatch.setattr(executors, "OnnxExtrapolation", counted)
    first = make(taau, extrapolation="guided-flow")
    with make(taau, extrapolation="guided-flow"):
        assert len(opened) <= 1, "none if another test has it open"
    first.close()


# --- where nothing moves, unshaded frames add nothing to the mean of the samples ---


STILL_BUT_A_DISC = LitScene(radius=7.0, disc_velocity=(0.5, 0.0))


at_rest = Frames(STILL_BUT_A_DISC, SIZE)


def mean_of(upscaler: Upscaler) -> Float32:
    history: Any = upscaler.save_state().history
    return np.array(history["history.static_mean"][0])


@pytest.mark.parametrize("executor", ["onnx", "cpu"])
@pytest.mark.parametrize("method", ["taau", "classifier-small"])
def test_unshaded_frames_add_nothing_to_the_mean_at_rest(method: str, executor: ExecutorName) -> None:
    upscaler = make(shared_model(method, executor))
    at_rest.run(upscaler, "s" * 24)
    for index, kind in enumerate("uusu", 24):
        before = mean_of(upscaler)
        at_rest.run(upscaler, kind, index)
        after = mean_of(upscaler)
        kept = after[3] > 0.0
        assert kept.mean() > 0.6
        if kind == "u":
            np.testing.assert_array_equal(after[:3, kept], before[:3, kept])
            np.testing.assert_array_equal(after[3, kept], before[3, kept])
            assert (after[3] == 0.0).any(), "where the disc moves, the mean ends"
        else:
            assert (after[3] > before[3] + 0.01).mean() > 0.3


@pytest.mark.parametrize("unshaded", [True, False])
@pytest.mark.parametrize("executor", ["onnx", "cpu"])
def test_where_each_jitter_comes_twice_still_frames_converge(executor: ExecutorName, unshaded: bool) -> None:
    """The second frame of a jitter is extrapolated, or shaded again; it is not part of the period."""
    upscaler = make(shared_model("taau", executor), display_size=(48, 32))
    frames, shares = still((24, 16), 2), []
    for index in range(4 * len(frames)):
        frame = with_default_gbuffers(frames[index % len(frames)], upscaler.gbuffers, (48, 32))
        if unshaded and index % 2:
            upscaler.extrapolate(replace(frame, color=None))
        else:
            upscaler.step(frame)
        shares.append(upscaler.stats.converged)
    assert shares[3 * len(frames) :] == [1.0] * len(frames)


# --- a model that looks at two shaded frames ---


SIZES = (SIZE, (48, 27), (80, 45), SIZE, (33, 19), SIZE)
SHADOW = Shadow(2.0, velocity=(1.3, -0.6))
lit = Frames(SHADOW, SIZE)


@pytest.mark.parametrize("pattern", ["susuus", "ssuuus", "suusuu"])
@pytest.mark.parametrize("sizes", [(SIZE,) * 6, SIZES])
def test_frames_are_extrapolated_as_by_torch(pattern: str, sizes: tuple[tuple[int, int], ...]) -> None:
    method = GuidedFlow.of(load_trained(shipped_weights("guided-flow"))).eval()
    wanted = extrapolated_by_torch(method, lambda index: lit(index, sizes[index]), pattern)
    model, history = Extrapolator("guided-flow", [CPU], 1), None
    for index, other in enumerate(wanted):
        if other is None:
            history = model.after_shaded(lit(index, sizes[index]), history)
            continue
        image, history = model.extrapolate(lit(index, sizes[index], color=None), history)
        off = np.abs(image - other)
        assert np.quantile(off, 0.99) < 1e-3
        assert off.mean() < 1e-4


def test_light_that_moves_is_extrapolated_better_than_by_guided_warp() -> None:
    flow, plain = (
        lit.run(make(shared_model("bilinear"), extrapolation=name), "susu")[-1]
        for name in ("guided-flow", "guided-warp")
    )
    truth = Upscaler("bilinear", display_size=DISPLAY).step(lit(3))
    assert np.square(flow - truth).mean() < np.square(plain - truth).mean()


def test_an_upscaler_steps_on_colors_extrapolated_from_two_shaded_frames(taau: Model) -> None:
    one, other = (make(taau, extrapolation=find_model("guided-flow")) for _ in range(2))
    image = lit.run(one, "susu")[3]
    other.step(lit(2))  # the same frames, of which the earlier ones are not known
    assert np.abs(image - other.extrapolate(lit(3, color=None))).mean() > 1e-3


# --- shots with unshaded frames, through the commands ---


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path, scene = tmp_path_factory.mktemp("shots") / "half", LitScene(velocity=(1.0, 0.3))
    with ShotWriter(path, name="half", display_size=DISPLAY, frame_rate=24) as writer:
        for index, kind in enumerate("suusu"):
            frame = scene.frame(index, SIZE, halton_jitter(index, 2.0))
            over = {} if kind == "s" else {"color": None}
            writer.write(
                scene.frame(index, SIZE, frame.jitter, **over), reference=scene.truth(index, DISPLAY)
            )
    return path


def test_upscale_renders_the_frames_that_were_not_shaded_and_resumes(folder: Path, tmp_path: Path) -> None:
    out, recording = tmp_path / "out", tmp_path / "a.recording"
    arguments = ("upscale", folder, "--method", "taau", "--extrapolate", "guided-warp", "-o", out)
    done = succeeded(cli(*arguments, "--compare", "--record", recording))
    assert "3 were not shaded" in said(done)
    upscaler = Upscaler("taau", display_size=DISPLAY, extrapolation="guided-warp")
    for index, item in enumerate(Shot.open(folder)):
        step = upscaler.step if item.frame.color is not None else upscaler.extrapolate
        written = read_exr(out / f"{index:04d}.exr")
        expected = step(item.frame).astype(np.float16)
        np.testing.assert_array_equal(np.stack([written[c] for c in "RGB"], -1), expected)
    last = (out / "0004.exr").read_bytes()
    (out / "0004.exr").unlink()
    assert cli(*arguments).exit_code == 0
    assert (out / "0004.exr").read_bytes() == last
    assert "5 of 5 frames are bit-identical to the recorded ones" in said(cli("replay", recording))


def test_an_unshaded_frame_is_named_with_the_option(folder: Path, tmp_path: Path) -> None:
    refused = cli("upscale", folder, "--method", "bilinear", "-o", tmp_path)
    assert refused.exit_code == 1
    assert "frame 1: frame.color is None" in said(refused)
    assert "--extrapolate" in said(refused)


def test_results_of_another_extrapolation_are_not_continued(folder: Path, tmp_path: Path) -> None:
    arguments = ("upscale", folder, "--method", "bilinear", "-o", tmp_path)
    assert cli(*arguments, "--extrapolate", "guided-warp").exit_code == 0
    assert "extrapolation was" in said(cli(*arguments))


def test_extrapolation_models_are_listed_separately_and_do_not_upscale(tmp_path: Path) -> None:
    assert re.search(r"models .*taau .*extrapolation guided-flow, guided-warp", said(cli("info")))
    assert "computes the colour of unshaded frames" in said(cli("info", "guided-warp"))
    refused = cli("upscale", "plaza", "--method", "guided-warp", "-o", tmp_path)
    assert refused.exit_code == 1
    assert "does not upscale" in said(refused)
    refused = cli("upscale", "plaza", "--extrapolate", "taau", "-o", tmp_path)
    assert "'taau' upscales" in said(refused)
    assert "gbuffer['base_color'] is None" in said(
        cli("upscale", "plaza", "--extrapolate", "guided-warp", "-o", tmp_path)
    )
