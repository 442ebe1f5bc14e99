"""A method that reads G-buffers gets exactly those, of the right sizes, through every API."""

import re
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from gbuffer_method import DARK, RATIO, WANTED, exported, gbuffers, lit
from noise import noise
from supersampler import Conventions, Frame, FrameError, Model, RawFrame, Shot, Upscaler
from supersampler.backends.onnx.session import image_of, planes_of
from supersampler.frame import Size
from supersampler.io.images import write_exr
from supersampler.io.shot import ShotWriter, import_channels
from supersampler.methods.gbuffers import GBUFFERS, gbuffer_arrays, grouped, lacking, sampled
from supersampler.recording import StepCall, open_recording
from supersampler.recording.replay import Replay
from upscale_runs import pixels, run, said, succeeded

RENDER, DISPLAY = (32, 18), (64, 36)


@pytest.fixture(scope="module")
def gbuffer_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported(tmp_path_factory)


@pytest.fixture(scope="module")
def model(gbuffer_model: Path) -> Model:
    return Model.load(gbuffer_model, threads=1)


def upscaler(model: Model, **options: Any) -> Upscaler:
    return Upscaler(model, **{"display_size": DISPLAY, "validate": "off", **options})


def tensors_of(frame: Frame) -> dict[str, Any]:
    return {name: torch.from_numpy(planes_of(image_of(frame, name))) for name in ("color", *WANTED)}


def stepped(one: Upscaler, frame: Frame, **without: Any) -> NDArray[np.float32]:
    tensors = {**tensors_of(frame), **without}
    return np.array(np.from_dlpack(one.step_tensors(tensors, jitter=frame.jitter, reset=frame.reset)))


def by_hand(frame: Frame, previous: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the method's image and next history, in numpy."""
    low, high, normal = (image_of(frame, name).astype(np.float32) for name in WANTED)
    light = np.asarray(frame.color) / (low + DARK)
    for axis in (0, 1):
        size, jitter = light.shape[axis], frame.jitter[1 - axis]
        position = (np.arange(RATIO * size) + 0.5) / RATIO - 0.5 - jitter
        first, share = np.floor(position).astype(int), (position - np.floor(position)).astype(np.float32)
        below, above = (np.take(light, np.clip(first + k, 0, size - 1), axis) for k in (0, 1))
        share = share[:, None, None] if axis == 0 else share[:, None]
        light = below + share * (above - below)
    image = light * (high + DARK) * (1.0 + 0.1 * normal[..., 2:])
    return 0.9 * image + 0.1 * previous, image


def test_a_method_reads_the_buffers_it_declares(model: Model) -> None:
    assert (model.executor, model.info.gbuffers, model.info.only_ratio) == ("onnx", WANTED, RATIO)
    one, previous = upscaler(model), np.zeros((*DISPLAY[::-1], 3), np.float32)
    for seed in (1, 2, 0, 3):
        frame = lit(seed)
        expected, previous = by_hand(frame, np.zeros_like(previous) if frame.reset else previous)
        np.testing.assert_allclose(one.step(frame), expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
def test_a_buffer_that_a_method_does_not_read_may_have_any_size(executor: Any) -> None:
    frame = noise(1)
    with_buffer = replace(frame, gbuffer_display={"normal": np.zeros((5, 7, 3), np.float32)})
    one, other = (Upscaler("taau", display_size=DISPLAY, executor=executor) for _ in range(2))
    np.testing.assert_array_equal(one.step(frame), other.step(with_buffer))


def test_a_converter_names_a_buffer_as_a_user_does() -> None:
    frame, bad = noise(1), {"normal": np.zeros((2, 2, 3), np.uint8)}
    raw = RawFrame(depth=frame.depth, motion=frame.motion, gbuffer_display=bad)  # type: ignore[arg-type]
    with pytest.raises(FrameError, match=r"frame\.gbuffer_display\['normal'\] is uint8"):
        Conventions().converter().to_frame(raw)


@pytest.mark.parametrize("name", WANTED[1:])
def test_a_buffer_that_is_missing_is_named_and_the_history_stays(model: Model, name: str) -> None:
    one, other = upscaler(model), upscaler(model)
    for u in (one, other):
        u.step(lit(1))
    place = GBUFFERS[name]
    with pytest.raises(FrameError) as caught:
        other.step(lit(2, drop=name))
    assert caught.value.name == str(place) == f"{place.group}['{place.key}']"
    wanted = f"want {place.shape(RENDER, DISPLAY)}. 'demodulated' reads it: render it at display size"
    assert f"is None; {wanted}" in str(caught.value)
    np.testing.assert_array_equal(one.step(lit(3)), other.step(lit(3)))


def test_a_missing_buffer_is_read_at_the_display_pixel_nearest_to_each_sample(model: Model) -> None:
    frame = replace(lit(1), jitter=(0.3, -0.45))
    display = image_of(frame, WANTED[1])
    # samples at 2 (i + 0.5 + jitter): 1.6 and 0.1 display pixels from the corner, then every second one
    color = display[0::2, 1::2]
    filled = replace(frame, gbuffer={**(frame.gbuffer or {}), "base_color": color})
    missing = replace(frame, gbuffer=None)
    gbuffer: Any = sampled(missing, WANTED, DISPLAY).gbuffer
    np.testing.assert_array_equal(gbuffer["base_color"], color)
    np.testing.assert_array_equal(upscaler(model).step(missing), upscaler(model).step(filled))
    assert missing.gbuffer is None, "the caller's frame is unchanged"


@given(
    render=st.tuples(st.integers(1, 9), st.integers(1, 9)),
    ratio=st.floats(1.0, 4.0),
    jitter=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)),
)
def test_samples_are_read_at_most_half_a_pixel_away(
    render: Size, ratio: float, jitter: tuple[float, float]
) -> None:
    display = round(ratio * render[0]), round(ratio * render[1])
    places = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in display)), axis=2).astype(np.float32)
    places = np.concatenate([places, places[..., :1]], axis=2)
    frame = replace(noise(1, render), jitter=jitter, gbuffer_display={"base_color": places})
    gbuffer: Any = sampled(frame, WANTED[:1], display).gbuffer
    found = gbuffer["base_color"]
    for axis in (0, 1):
        samples = np.arange(render[axis]) + 0.5 + jitter[axis]
        where = np.clip(samples * display[axis] / render[axis], 0.5, display[axis] - 0.5)
        seen = found[..., axis] if axis == 0 else found[..., axis].T
        assert np.abs(seen - where).max() <= 0.5 + 1e-4


def test_buffers_that_a_method_does_not_use_are_neither_asked_for_nor_looked_at(model: Model) -> None:
    wanted = {name: image_of(lit(1), name) for name in WANTED}
    spoilt = {**gbuffers(1, RENDER, DISPLAY), **wanted}
    for name in spoilt.keys() - set(WANTED):
        spoilt[name] = np.full_like(spoilt[name], np.nan)
    groups = ("gbuffer", "gbuffer_display")
    fields: list[Any] = [dict(zip(groups, grouped(found), strict=True)) for found in (wanted, spoilt)]
    frames = [replace(lit(1), **changed) for changed in fields]
    few, many = (upscaler(model, validate="strict").step(frame) for frame in frames)
    np.testing.assert_array_equal(few, many)
    plain = Upscaler("bilinear", display_size=DISPLAY, executor="onnx", threads=1)
    np.testing.assert_array_equal(plain.step(frames[1]), plain.step(noise(1)))


def test_tensors_give_the_image_that_arrays_give(model: Model) -> None:
    one, other = upscaler(model), upscaler(model)
    for seed in (1, 2, 0, 3):
        frame = lit(seed)
        np.testing.assert_array_equal(stepped(other, frame), one.step(frame).transpose(2, 0, 1)[None])


@pytest.mark.parametrize(
    ("render", "display", "would_do"),
    [
        ((32, 18), (64, 37), "a display of (64, 36)"),
        ((32, 18), (66, 36), "frames of (33, 18) or a display of (64, 36)"),
        ((32, 18), (96, 54), "frames of (48, 27) or a display of (64, 36)"),
        ((1, 1), (1, 1), "a display of (2, 2)"),
    ],
)
def test_sizes_that_would_do_are_said(model: Model, render: Size, display: Size, would_do: str) -> None:
    said = (
        f"frame.size is {render}, for a display of {display}; want {would_do}: this method upscales exactly"
    )
    for refuse in (
        lambda: upscaler(model, display_size=display).step(lit(1, render)),
        lambda: model.plan(render, display),
    ):
        with pytest.raises(FrameError, match=re.escape(said)):
            refuse()


@pytest.mark.parametrize("render", [(1, 1), (1, 9), (33, 17)])
def test_odd_and_tiny_sizes_are_rendered(model: Model, render: Size) -> None:
    frame, previous = lit(1, render), np.zeros((2 * render[1], 2 * render[0], 3), np.float32)
    image = upscaler(model, display_size=None, scale=2.0).step(frame)
    np.testing.assert_allclose(image, by_hand(frame, previous)[0], rtol=1e-4, atol=1e-5)


def test_a_recording_holds_only_buffers_that_are_used(
    model: Model, gbuffer_model: Path, tmp_path: Path
) -> None:
    file = tmp_path / "a.recording"
    with upscaler(model, record=file) as one:
        for seed in (1, 2):
            one.step(lit(seed))
        with pytest.raises(FrameError):
            one.step(lit(3, drop=WANTED[2]))
        stepped(one, lit(4))
        with pytest.raises(FrameError, match=r"frame\.gbuffer_base_color is None"):
            one.step_tensors({"color": tensors_of(lit(4))["color"]}, jitter=(0.0, 0.0))
    recording = open_recording(file)
    frames = [call.frame for call in recording if isinstance(call, StepCall)]
    assert [[*gbuffer_arrays(frame)] for frame in frames] == [[*WANTED], [*WANTED], [*WANTED[:2]], [*WANTED]]
    for name in WANTED[:2]:
        np.testing.assert_array_equal(image_of(frames[2], name), image_of(lit(3), name))
    replay = Replay(recording, model=gbuffer_model)
    steps = [step for step in map(replay.call, recording) if step is not None]
    assert [step.exact for step in steps] == [True] * 4
    assert "gbuffer_display['normal']" in steps[2].note


@pytest.mark.parametrize(
    ("wanted", "given", "missing"),
    [
        (WANTED, WANTED[1:], []),
        (WANTED, WANTED[:1], list(WANTED[1:])),
        (("gbuffer_normal",), ("gbuffer_display_normal",), ["gbuffer_normal"]),  # the method reads no other
    ],
)
def test_only_inputs_without_a_default_count_as_missing(wanted: Any, given: Any, missing: list[str]) -> None:
    assert lacking(wanted, given) == missing


def test_an_upscaler_checks_what_its_method_reads(model: Model) -> None:
    one, other = upscaler(model, validate="strict"), upscaler(model, validate="strict")
    for u in (one, other):
        u.step(lit(1))
    wrong = lit(2, gbuffer_base_color=np.full((18, 32, 3), 7.5, np.float32))
    with pytest.raises(FrameError, match=r"gbuffer\['base_color'\] is outside"):
        other.step(wrong)
    np.testing.assert_array_equal(one.step(lit(3)), other.step(lit(3)))


# --- shots with G-buffers through the commands: what a model reads is read, and no more ---


FRAMES = 3


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A shot with all G-buffers."""
    path = tmp_path_factory.mktemp("shots") / "lit"
    with ShotWriter(path, name="lit", display_size=DISPLAY, frame_rate=24) as writer:
        for seed in range(FRAMES):
            writer.write(lit(seed), reference=np.full((*DISPLAY[::-1], 3), 0.5, np.float16))
    return path


def assert_upscaled(out: Path, frames: Sequence[Frame], model: Path) -> None:
    upscaler = Upscaler(model, display_size=DISPLAY)
    for index, frame in enumerate(frames):
        stored = pixels(out / f"{index:04d}.exr")
        np.testing.assert_array_equal(stored, upscaler.step(frame).astype(np.float16))


def test_upscale_hands_buffers_to_a_model_that_reads_them(
    folder: Path, gbuffer_model: Path, tmp_path: Path
) -> None:
    recorded = ("--record", tmp_path / "a.recording")
    upscale = ("upscale", folder, "--model", gbuffer_model, "-o", tmp_path / "out")
    succeeded(run(*upscale, *recorded))
    assert_upscaled(tmp_path / "out", [item.frame for item in Shot.open(folder)], gbuffer_model)
    replayed = run("replay", tmp_path / "a.recording", "--model", gbuffer_model)
    assert f"{FRAMES} of {FRAMES} frames are bit-identical to the recorded ones" in said(replayed)


def test_buffers_of_display_size_replace_those_of_render_size(gbuffer_model: Path, tmp_path: Path) -> None:
    frame = replace(lit(1), gbuffer=None)
    with ShotWriter(tmp_path / "shot", name="shot", display_size=DISPLAY, frame_rate=24) as writer:
        writer.write(frame)
    succeeded(run("upscale", tmp_path / "shot", "--model", gbuffer_model, "-o", tmp_path / "out"))
    assert_upscaled(tmp_path / "out", [frame], gbuffer_model)


def test_upscale_reads_only_what_a_model_asks_for(folder: Path, gbuffer_model: Path, tmp_path: Path) -> None:
    broken = Path(shutil.copytree(folder, tmp_path / "broken"))
    for file in broken.rglob("display/*"):
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    assert run("upscale", broken, "--method", "bilinear", "-o", tmp_path / "one").exit_code == 0
    refused = run("upscale", broken, "--model", gbuffer_model, "-o", tmp_path / "other")
    assert refused.exit_code == 1
    assert "0000.exr" in said(refused)


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
def test_a_shot_reads_the_named_buffers(folder: Path, names: tuple[str, ...]) -> None:
    whole = list(Shot.open(folder))
    assert all([*gbuffer_arrays(item.frame)] == [*GBUFFERS] for item in whole)
    for item, all_of_it in zip(Shot.open(folder).frames(gbuffers=names), whole, strict=True):
        assert set(gbuffer_arrays(item.frame)) == set(names)
        for name in names:
            found, expected = (GBUFFERS[name].find(frame) for frame in (item.frame, all_of_it.frame))
            np.testing.assert_array_equal(found, expected)
        np.testing.assert_array_equal(item.frame.depth, all_of_it.frame.depth)
        np.testing.assert_array_equal(item.frame.motion, all_of_it.frame.motion)


def test_imported_shots_read_the_buffers_that_are_named(tmp_path: Path) -> None:
    grey = np.full((6, 8), 0.5, np.float32)
    write_exr(tmp_path / "0.exr", dict.fromkeys(("R", "G", "B", "Z", "U", "V"), grey))
    channel_map: dict[str, Any] = {"color": ["R", "G", "B"], "depth": "Z", "motion": ["U", "V"]}
    for name in ("roughness", "metallic"):
        write_exr(tmp_path / name / "0.exr", {"value": grey})
        channel_map[name] = f"{name}/*.exr:value"
    shot = import_channels(tmp_path, channel_map, conventions=Conventions())
    (item,) = shot.frames(gbuffers=("gbuffer_metallic",))
    assert [*gbuffer_arrays(item.frame)] == ["gbuffer_metallic"]
    assert [*gbuffer_arrays(shot.read(0).frame)] == ["gbuffer_roughness", "gbuffer_metallic"]
