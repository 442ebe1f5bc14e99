"""Outputs of a step beside the image: maps that explain it, and AOVs."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from OpenImageIO import ImageBuf

from method_lists import WITH_KERNELS
from noise import noise
from shared_models import shared_model
from supersampler import ArgumentError, Frame, FrameError, Model, StepResult, Upscaler
from supersampler.arguments import ExecutorName
from supersampler.aux_outputs import CLASS_COLORS, aux_output_layers, class_colors
from supersampler.cli.results import ImageOptions, OutputImage
from supersampler.conventions.encodings import srgb_decoded
from supersampler.io.display import MAX_HALF, display_transform, to_uint16
from supersampler.io.images import read_exr, read_image, write_exr, write_png
from supersampler.io.shot import ShotWriter
from supersampler.validation import FrameChecker
from upscale_runs import OURS, run, succeeded, upscale

DISPLAY = (64, 36)
STILL = np.zeros((18, 32, 2), np.float32)


@pytest.fixture(scope="module", params=WITH_KERNELS)
def model(request: pytest.FixtureRequest) -> Model:
    return shared_model(request.param)


def make(model: Model | str) -> Upscaler:
    return Upscaler(model, display_size=DISPLAY, validate="off")


def with_aovs(seed: int, channels: int = 2) -> Frame:
    """Return a frame whose AOVs are its own colour's first channels, scaled to [0, 1]."""
    return noise(seed, aovs=(np.asarray(noise(seed).color) / 8.0)[..., :channels].copy())


def stepped(upscaler: Upscaler, frame: Frame, *outputs: str) -> Any:
    """Return the result of a step; these maps are there."""
    return upscaler.step(frame, outputs=outputs)


def test_outputs_do_not_change_the_image_and_a_saved_state_holds_them(model: Model) -> None:
    silent, asked, fork = make(model), make(model), make(model)
    for seed in range(3):
        result = stepped(asked, with_aovs(seed), "weight", "aovs")
        np.testing.assert_array_equal(result.image, silent.step(noise(seed)))
    fork.load_state(asked.save_state())
    ours, theirs = (stepped(one, with_aovs(3), "aovs") for one in (asked, fork))
    np.testing.assert_array_equal(ours.aovs, theirs.aovs)


def test_the_first_frame_takes_nothing_from_the_history_and_the_next_ones_do(model: Model) -> None:
    upscaler = make(model)
    first, second = (stepped(upscaler, noise(seed), "weight").weight for seed in range(2))
    assert (first.shape, first.max()) == ((36, 64), 0.0)
    assert 0.0 <= second.min() < second.max() <= 1.0


def test_the_count_of_a_still_scene_grows() -> None:
    upscaler, still = make("taau"), [noise(1, motion=STILL, reset=index == 0) for index in range(6)]
    counts = [stepped(upscaler, frame, "count").count.mean() for frame in still]
    assert (np.diff(counts) > 0.0).all()


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
@pytest.mark.parametrize("method", ["classifier", "classifier-small"])
def test_pixels_without_history_are_classed_as_disoccluded(method: str, executor: ExecutorName) -> None:
    upscaler = Upscaler(shared_model(method, executor), display_size=(63, 37), validate="off")
    first = stepped(upscaler, noise(0, (32, 19), reset=True), "class_map").class_map
    assert first.shape == (19, 32, 6)
    assert (first[..., :3] == (0.0, 1.0, 0.0)).all()
    pan = np.full((19, 32, 2), (4.0, 0.0), np.float32)  # the last 7.9 display pixels come from off screen
    second = stepped(upscaler, noise(1, (32, 19), motion=pan), "class_map").class_map
    assert (second[:, 28:, :3] == (0.0, 1.0, 0.0)).all()
    assert second[:, :27, 1].max() < 1.0


def test_a_method_that_does_not_converge_has_no_such_map_and_no_such_number() -> None:
    upscaler = Upscaler(shared_model("taa", "onnx"), display_size=DISPLAY, validate="off")
    with pytest.raises(ArgumentError, match="converged"):
        upscaler.step(noise(0), outputs=("converged",))
    upscaler.step(noise(0))
    assert upscaler.stats.converged is None


def test_a_flat_channel_stays_flat_and_a_cut_forgets_it(model: Model) -> None:
    upscaler = make(model)
    for seed, value in ((0, 0.25), (1, 0.25), (0, 0.75)):  # noise(0) is a cut
        aovs: Any = stepped(upscaler, noise(seed, aovs=np.full((18, 32, 1), value, np.float32)), "aovs").aovs
        np.testing.assert_allclose(aovs, value, rtol=1e-5)


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
@pytest.mark.parametrize("value", [0.0, 1.0, -65504.0, 65504.0, np.inf])
def test_a_constant_channel_stays_constant_up_to_the_limit(executor: ExecutorName, value: float) -> None:
    upscaler = make(shared_model("taau", executor))
    for seed in range(4):
        aovs: Any = stepped(upscaler, noise(seed, aovs=np.full((18, 32, 1), value, np.float32)), "aovs").aovs
        np.testing.assert_allclose(aovs, np.clip(value, -MAX_HALF, MAX_HALF), rtol=1e-6)
        assert np.abs(aovs).max() <= MAX_HALF


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
@pytest.mark.parametrize("method", ["taau", "bilinear"])
def test_a_channel_that_begins_with_missing_samples_takes_the_first_ones(
    method: str, executor: ExecutorName
) -> None:
    upscaler = make(shared_model(method, executor))
    aovs = np.full((18, 32, 2), 0.8, np.float32)
    hole = aovs.copy()
    hole[5:14, 9:25, 0] = np.nan
    for seed in range(5):
        result: Any = stepped(upscaler, noise(seed, aovs=hole if seed < 3 else aovs, motion=STILL), "aovs")
        np.testing.assert_allclose(result.aovs[..., 1], 0.8, rtol=1e-6)
        inside = result.aovs[14:24, 24:44, 0]
        np.testing.assert_allclose(inside, 0.0 if seed < 3 else 0.8, rtol=1e-6, atol=1e-20)
        around = np.unique(result.aovs[..., 0].round(5))  # nothing between
        assert set(around.tolist()) <= {0.0, np.float32(0.8)}, around


def test_a_channel_is_blended_by_the_weight_of_the_colour(model: Model) -> None:
    upscaler = make(model)
    zeros = np.zeros((18, 32, 1), np.float32)
    stepped(upscaler, noise(0, aovs=zeros), "aovs")
    result: Any = stepped(upscaler, noise(1, aovs=zeros + 1.0, motion=STILL), "aovs", "weight")
    np.testing.assert_allclose(result.aovs[..., 0], 1.0 - result.weight, atol=1e-5)


def test_a_bad_value_in_a_channel_does_not_spread(model: Model) -> None:
    upscaler = make(model)
    aovs = np.full((18, 32, 1), 0.5, np.float32)
    stepped(upscaler, noise(0, aovs=aovs), "aovs")
    bad = aovs.copy()
    bad[4, 5], bad[9, 9], bad[2, 2] = np.nan, np.inf, -np.inf
    for seed in range(1, 4):
        result: Any = stepped(upscaler, noise(seed, aovs=bad if seed == 1 else aovs), "aovs")
        assert np.isfinite(result.aovs).all()


def test_a_nan_in_a_channel_is_a_missing_sample_of_that_channel_alone(model: Model) -> None:
    upscaler, whole = make(model), make(model)
    aovs = np.full((18, 32, 2), 0.8, np.float32)
    for seed in range(8):
        given = aovs.copy()
        given[6:10, 10:16, 0] = np.nan if seed == 6 else 0.8
        result, other = (
            stepped(one, noise(seed, aovs=values, motion=STILL), "aovs").aovs
            for one, values in ((upscaler, given), (whole, aovs))
        )
        np.testing.assert_allclose(result[..., 0], 0.8, atol=1e-4)
        np.testing.assert_array_equal(result[..., 1], other[..., 1])


REFUSED: dict[str, tuple[Frame, Any]] = {
    "class_map": (with_aovs(1), ("class_map",)),
    "outputs": (with_aovs(1), "aovs"),
    "aovs is None": (noise(1), ("aovs",)),
    "aovs is 1 channels": (with_aovs(1, channels=1), ("aovs",)),
}


def test_an_output_that_a_method_lacks_is_refused_and_the_next_frame_works(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    upscaler, other, seen = make("taau"), make("taau"), list[Frame]()
    for one in (upscaler, other):
        stepped(one, with_aovs(0), "aovs")
    monkeypatch.setattr(FrameChecker, "check", lambda _, frame, *__: seen.append(frame))
    for message, (frame, outputs) in REFUSED.items():
        with pytest.raises((ArgumentError, FrameError), match=message):
            upscaler.step(frame, outputs=outputs)
    assert not seen, "the checks, which remember frames"
    ours, theirs = (stepped(one, with_aovs(1), "aovs") for one in (upscaler, other))
    assert len(seen) == 2
    np.testing.assert_array_equal(ours.image, theirs.image)
    np.testing.assert_array_equal(ours.aovs, theirs.aovs)


def test_alpha_of_a_shot_ends_in_the_exr_files(tmp_path: Path) -> None:
    writer = ShotWriter(tmp_path / "shot", name="alpha", display_size=None, frame_rate=30.0)
    for seed in range(2):
        writer.write(noise(seed, aovs=np.full((18, 32, 1), 0.5, np.float32)))
    out = tmp_path / "out"
    arguments = ["upscale", str(tmp_path / "shot"), "-o", str(out), "--compare", "--maps"]
    succeeded(run(*arguments, "--method", "taau"))
    channels = read_exr(out / "0001.exr")
    assert set(channels) == {"R", "G", "B", "A"}
    np.testing.assert_allclose(channels["A"], 0.5, atol=1e-3)
    page = (out / "compare.html").read_text("utf-8")
    assert 'id="1/weight"' in page
    assert 'id="1/count"' in page


def test_classes_have_the_colours_of_the_legend() -> None:
    probabilities = np.zeros((1, 5, 6), np.float32)
    for column, (ghost, alias) in enumerate([(1, 3), (1, 4), (2, 3), (0, 4), (0, 5)]):
        probabilities[0, column, [ghost, alias]] = 1.0
    assert [tuple(map(int, pixel)) for pixel in class_colors(probabilities)[0]] == list(CLASS_COLORS.values())
    image = np.zeros((2, 10, 3), np.float32)
    layers = aux_output_layers(
        StepResult(image, class_map=probabilities, weight=image[..., 0], count=image[..., 0])
    )
    assert list(layers) == ["classes", "weight", "count"]


# --- alpha: colours of PNG are not multiplied by it, those of EXR and all computed ones are ---


SIZE = (12, 16)
ALPHA = np.tile(np.array([0.0, 0.25, 0.5, 1.0], np.float32).repeat(4), (12, 1))
INSIDE = np.tile([False, True, True, False], (12, 4))
"""Pixels whose neighbours have the same alpha."""
STRAIGHT = np.array([0.6, 0.3, 0.1], np.float32)


def write_frames(folder: Path) -> Path:
    """One EXR frame with alpha, whose colour is multiplied by it; a glow of 0.2 is where alpha is 0."""
    color = np.where(ALPHA[..., None] > 0, ALPHA[..., None] * STRAIGHT, np.float32(0.2))
    channels = dict(zip("RGB", np.moveaxis(color, -1, 0), strict=True))
    channels |= {"A": ALPHA, "fog": np.ones(SIZE, np.float32), "Z": np.full(SIZE, 0.5, np.float32)}
    channels |= {"motion.X": np.zeros(SIZE, np.float32), "motion.Y": np.zeros(SIZE, np.float32)}
    write_exr(folder / "s.0001.exr", channels)
    return folder


@pytest.mark.parametrize("name", ["png", "tif"])
def test_alpha_is_kept_beside_straight_colours(tmp_path: Path, name: str) -> None:
    options = ("--scale", "1", "--format", name, "--format", "exr")
    upscale(write_frames(tmp_path / "in"), tmp_path / "out", *OURS, *options)
    path = tmp_path / "out" / name / f"s.0001.{name}"
    image = ImageBuf(str(path)).spec()
    assert (image.channelnames, image.alpha_channel) == (("R", "G", "B", "A"), 3)
    found = read_image(path)
    np.testing.assert_allclose(found["A"][INSIDE], ALPHA[INSIDE], atol=3e-3)
    covered = np.stack([found[axis] for axis in "RGB"], axis=-1)[INSIDE & (ALPHA > 0)]
    np.testing.assert_allclose(covered, np.broadcast_to(covered[-1], covered.shape), atol=6e-3)
    assert (found["R"][INSIDE & (ALPHA == 0)] > 0.1).all()  # the glow is still there, for those who add it
    linear = read_image(tmp_path / "out" / "exr" / "s.0001.exr")
    multiplied = (ALPHA * STRAIGHT[0])[INSIDE & (ALPHA > 0)]
    np.testing.assert_allclose(linear["R"][INSIDE & (ALPHA > 0)], multiplied, rtol=3e-3)


def written(folder: Path, aovs: float, *formats: str, grey: float = 0.4, **fields: Any) -> Any:
    """Write an even image, with AOVs of one value; return what a video would show of it."""
    image, channels = np.full((2, 3, 3), grey, np.float32), 2 if "aov_names" in fields else 1
    output = OutputImage(
        image=image, exposure=1.0, aovs=np.full((2, 3, channels), aovs, np.float32), **fields
    )
    return ImageOptions(formats=[*formats]).write(folder, 1, output)


def test_opaque_pixels_are_shown_as_without_alpha(tmp_path: Path) -> None:
    video = written(tmp_path, 1.0, "tif", "mp4")
    found = read_image(tmp_path / "0001.tif")
    want = to_uint16(display_transform(np.full((2, 3, 3), 0.4, np.float32))) / 65535
    np.testing.assert_allclose(np.stack([found[axis] for axis in "RGB"], -1), want, atol=1e-5)
    assert (found["A"] == 1).all()
    assert video.shape == (2, 3, 3)


def test_a_video_shows_the_image_over_black(tmp_path: Path) -> None:
    beside, alone = (written(tmp_path, 0.5, *names, grey=0.1) for names in (["png", "mp4"], ["mp4"]))
    np.testing.assert_array_equal(beside, alone)


@pytest.mark.parametrize("names", [None, ("fog", "mist")])
def test_without_alpha_png_has_three_channels(tmp_path: Path, names: tuple[str, ...] | None) -> None:
    written(tmp_path, 1.0, "png", aov_names=names)
    assert read_image(tmp_path / "0001.png").keys() == set("RGB")


@pytest.mark.parametrize("value", [np.nan, -1.0, 2.0])
def test_alpha_is_written_within_0_and_1(tmp_path: Path, value: float) -> None:
    written(tmp_path, value, "png")
    assert (read_image(tmp_path / "0001.png")["A"] == (value == 2.0)).all()


def test_frames_of_png_with_alpha_come_back_alike_and_are_multiplied_in_exr(tmp_path: Path) -> None:
    pixels = np.full((*SIZE, 4), 128, np.uint8)
    write_png(tmp_path / "in" / "color" / "c.0001.png", pixels)
    write_frames(tmp_path / "in")
    channels = """{"color": ["color/c.*.png:R", "color/c.*.png:G", "color/c.*.png:B"], "depth": "Z",
        "aovs": "color/c.*.png:A", "motion": ["motion.X", "motion.Y"]}"""
    options = ("--channels", channels, "--conventions", '{"srgb": true}')
    succeeded(run("import", tmp_path / "in", "-o", tmp_path / "shot", *options))
    for source, given in (("in", options), ("shot", ())):
        out = tmp_path / f"of {source}"
        upscale(tmp_path / source, out, *given, "--scale", "1", "--format", "png", "--format", "exr")
        found, linear = read_image(out / "png" / "c.0001.png"), read_image(out / "exr" / "c.0001.exr")
        for name in "RGBA":
            np.testing.assert_allclose(found[name], 128 / 255, atol=5e-3)
        want = linear["A"] * srgb_decoded(np.array([128 / 255], np.float32))
        np.testing.assert_allclose(linear["G"], want.astype(np.float32), rtol=2e-3)
