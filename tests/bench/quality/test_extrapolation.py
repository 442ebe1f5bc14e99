"""`bench extrapolation`: which frames are unshaded, their images, and which frames each score counts."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from joint_folder import joint_folder
from lit_scene import LitScene, even
from supersampler import ArgumentError, Frame, Shot, ShotError, halton_jitter
from supersampler.frame import Float32
from supersampler.io.shot import ShotFrame, ShotWriter
from supersampler.methods.model_file import shipped_model
from supersampler_bench.quality.extrapolation import (
    PSNR_SHADED,
    TEMPORAL_METRICS,
    Alternation,
    ExtrapolationRecord,
    UnshadedScores,
    WarpBaseline,
    measure_extrapolation,
    motion_over_two_frames,
    unshaded_row,
    warped,
    with_background_filled,
)
from supersampler_bench.quality.masks import disoccluded
from supersampler_bench.quality.scores import FRAME_METRICS, MASKED, WEIGHTED, FrameScores, MethodScores
from supersampler_bench.record import read_record, write_json
from supersampler_bench.report.doc_tables import block_text, blocks_of
from upscale_runs import run

SIZE, DISPLAY, FRAMES = (48, 27), (96, 54), 12
SCENE = LitScene(velocity=(1.3, -0.6), radius=7.0, disc_velocity=(2.5, 0.5))
ITEM: dict[str, Any] = {"raw": None, "reference": None}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("shots") / "lit"
    with ShotWriter(path, name="lit", display_size=DISPLAY, frame_rate=24) as writer:
        for index in range(FRAMES):
            frame = SCENE.frame(index, SIZE, halton_jitter(index, 2.0))
            writer.write(frame, reference=SCENE.truth(index, DISPLAY))
    return path


def unshaded(text: str, resets: set[int]) -> str:
    alternation, said = Alternation(text), ""
    for index in range(9):
        item = ShotFrame(index=index, frame=SCENE.frame(index, SIZE, reset=index in resets), **ITEM)
        said += "u" if alternation.leaves_unshaded(item) else "s"
        assert alternation.leaves_unshaded(item) == (said[-1] == "u")  # each way asks
    assert alternation.indices == {index for index, kind in enumerate(said) if kind == "u"}
    return said


@pytest.mark.parametrize(
    ("text", "resets", "said"),
    [
        ("1:1", {0}, "susususus"),
        ("2:1", {0}, "suusuusuu"),
        ("1:1", {0, 3}, "sussususu"),
        ("2:1", {0, 1, 5}, "ssuussuus"),
    ],
)
def test_frames_are_unshaded_after_each_shaded_one_and_never_after_a_cut(
    text: str, resets: set[int], said: str
) -> None:
    assert unshaded(text, resets) == said


@pytest.mark.parametrize("text", ["1", "0:1", "1:2", "a:1", "-1:1", ""])
def test_other_alternations_are_refused(text: str) -> None:
    with pytest.raises(ArgumentError, match="--alternation"):
        Alternation(text)


def scores_of(frame: int, value: float) -> FrameScores:
    weights = (*(f"pixels_{name}" for name in MASKED), *(f"weight_{name}" for name in WEIGHTED))
    scores = dict.fromkeys(FRAME_METRICS, value) | dict.fromkeys(weights, 1.0)
    scores |= {"srred": value, "trred": value}
    return FrameScores(frame, full=scores, cropped=scores)


def test_scores_are_of_unshaded_frames_and_changes_of_all() -> None:
    scores = MethodScores(
        "m", [scores_of(8, 10.0), scores_of(9, 20.0), scores_of(10, 30.0), scores_of(11, 60.0)]
    )
    summary = UnshadedScores.of(scores, {9, 11}).summary()
    assert (summary["psnr"], summary["flip"], summary[PSNR_SHADED]) == (40.0, 40.0, 20.0)
    assert {summary[name] for name in TEMPORAL_METRICS if name != "strred"} == {30.0}


# --- warping ---


def test_an_image_is_warped_by_motion_and_its_border_is_repeated() -> None:
    image = np.random.default_rng(0).random((36, 64, 3), np.float32)
    frame = LitScene(velocity=(3.0, -2.0)).frame(1, (64, 36))
    moved = warped(image, frame)
    np.testing.assert_allclose(moved[:-2, 3:], image[2:, :-3], atol=1e-6)
    np.testing.assert_allclose(moved[:-2, 0], image[2:, 0], atol=1e-6)


def test_disoccluded_pixels_are_filled_from_the_nearest_background() -> None:
    scene = LitScene(base=even, radius=7.0, disc_velocity=(3.0, 0.0))
    before, frame = scene.frame(0, (64, 36)), scene.frame(1, (64, 36))
    assert before.color is not None
    assert frame.color is not None
    image, unshaded = warped(before.color, frame), disoccluded(frame, before)
    filled = with_background_filled(image, frame, before)
    assert (scene.uncovered(1) & unshaded).sum() > 20
    assert np.abs(image - frame.color)[unshaded].mean() > 1.0
    assert np.abs(filled - frame.color)[unshaded].max() < 0.1
    np.testing.assert_array_equal(filled[~unshaded], image[~unshaded])


def test_pixels_without_a_near_background_are_unchanged() -> None:
    scene = LitScene(radius=200.0, disc_velocity=(3.0, 0.0))
    before, image = scene.frame(0, (64, 36)), np.ones((36, 64, 3), np.float32)
    behind = replace(scene.frame(1, (64, 36)), depth=np.full((36, 64), 1e-3, np.float32))
    np.testing.assert_array_equal(with_background_filled(image, behind, before), image)


def test_motion_spans_unshaded_frames_back_to_a_shaded_sample() -> None:
    x = np.arange(48, dtype=np.float32)[None, :, None]
    sheared = np.broadcast_to(x * np.array([0.1, -0.05]), (27, 48, 2)).astype(np.float32)
    frame = replace(SCENE.frame(1, SIZE), motion=np.full((27, 48, 2), -1.5, np.float32), jitter=(0.3, -0.1))
    assert motion_over_two_frames(frame, None, (0.0, 0.0)) is frame.motion
    total = motion_over_two_frames(frame, sheared, (-0.2, 0.4))
    places = x - 1.5 + 0.5  # of the samples then: moved, and this jitter less that
    expected = np.broadcast_to(-1.5 + 0.1 * places, (27, 48, 1))[..., 0]
    np.testing.assert_allclose(total[3:, 3:, 0], expected[3:, 3:], atol=1e-5)
    np.testing.assert_array_equal(total[:, 0], frame.motion[:, 0])  # off screen
    coarse = np.broadcast_to(np.array([1.0, -0.5], np.float32), (9, 12, 2))  # a quarter of the width, a third
    total = motion_over_two_frames(frame, coarse, (-0.2, 0.4))
    np.testing.assert_allclose(total[3:, 3:], np.broadcast_to([-1.5 + 4.0, -1.5 - 1.5], (24, 45, 2)))


class Taker:
    """Stands where an Upscaler would; keeps what it is handed in."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []

    def step(self, frame: Frame) -> Float32:
        self.frames.append(frame)
        return np.full((54, 96, 3), float(len(self.frames)), np.float32)


@pytest.mark.parametrize("filled", [False, True])
def test_the_warp_baseline_upscales_only_shaded_frames_with_motion_between_them(filled: bool) -> None:
    taker: Any = Taker()
    warping, scene = WarpBaseline(taker, Alternation("2:1"), filled=filled), LitScene(velocity=(1.0, -0.5))
    frames = [replace(scene.frame(index, SIZE), pre_exposure=2.0**index) for index in range(7)]
    images = [warping.step(ShotFrame(index=index, frame=frame, **ITEM)) for index, frame in enumerate(frames)]
    assert [image[20, 40, 0] for image in images] == [1, 2, 4, 2, 4, 8, 3]
    pixels = np.array(SIZE) / (64, 36)
    for frame in taker.frames[1:]:
        np.testing.assert_allclose(
            frame.motion[10:-10, 10:-10], np.broadcast_to((-3.0, 1.5) * pixels, (7, 28, 2))
        )
    np.testing.assert_array_equal(taker.frames[0].motion, scene.frame(0, SIZE).motion)


# --- the whole ---


def test_an_extrapolated_frame_beats_a_warped_one_in_disocclusions(folder: Path) -> None:
    found = measure_extrapolation(Shot.open(folder), ["taau"], ["guided-warp"], ["1:1", "2:1"])
    assert list(found) == ["1:1", "2:1"]
    for scores in found.values():
        by_way = {s.method: s.summary(warm=False) for s in scores}
        assert list(by_way) == ["taau, shaded", "taau, warp", "taau, warp, filled", "taau, guided-warp"]
        shaded, plain, filled, extrapolated = (summary["psnr_disoccluded"] for summary in by_way.values())
        assert extrapolated > filled + 1.0
        assert filled > plain
        assert abs(shaded - extrapolated) < 2.0
        assert by_way["taau, guided-warp"]["psnr"] > by_way["taau, warp, filled"]["psnr"] + 1.0


def test_two_passes_have_rows_of_their_own_and_are_better(folder: Path) -> None:
    found = measure_extrapolation(Shot.open(folder), ["taau"], ["guided-warp", "guided-warp:x2"], ["1:1"])
    by_way = {s.method: s.summary(warm=False) for s in found["1:1"]}
    assert list(by_way)[-3:] == ["taau, guided-warp", "taau, shaded x2", "taau, guided-warp x2"]
    one, shaded, two = list(by_way.values())[-3:]
    assert two["psnr"] > one["psnr"] + 0.3
    assert shaded["psnr"] > two["psnr"]


def test_models_of_one_method_have_rows_of_their_own_names(folder: Path, tmp_path: Path) -> None:
    mine = str(shutil.copytree(shipped_model("guided-warp"), tmp_path / "mine"))
    models = ["guided-warp", mine, "guided-warp:x2", f"{mine}:x2"]
    found = measure_extrapolation(Shot.open(folder), ["bilinear"], models, ["1:1"])
    ways = [scores.method.removeprefix("bilinear, ") for scores in found["1:1"][3:]]
    assert ways == ["guided-warp", mine, "shaded x2", "guided-warp x2", f"{mine} x2"]


def test_the_command_prints_a_table_and_writes_its_record(folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "extrapolation-lit.json"
    arguments = ["bench", "extrapolation", str(folder), "--methods", "bilinear", "--alternation", "1:1"]
    done = run(*arguments, "--json", file)
    assert done.exit_code == 0
    record = read_record(file)
    table = ExtrapolationRecord.from_json(record).table()
    assert "| bilinear, guided-warp |" in table
    assert "lit, 48x27 to 96x54, 1:1 unshaded to shaded frames" in table
    assert block_text(record, blocks_of("extrapolation-lit", record)["extrapolation lit"]) == table
    assert table.splitlines()[2] in done.output


def test_the_table_of_several_shots_has_their_mean(folder: Path, tmp_path: Path) -> None:
    shot = Shot.open(folder)
    found = measure_extrapolation(shot, ["bilinear"], ["guided-warp"], ["1:1"])
    scores = unshaded_row(shot, found, {"ratio": 2.0})
    write_json(ExtrapolationRecord.of([scores, scores], ["guided-warp"]), tmp_path / "a.json")
    table = ExtrapolationRecord.from_json(read_record(tmp_path / "a.json")).table()
    assert table.count("| bilinear, warp |") == 1
    assert "Mean of the shots lit, lit at ratio 2, 1:1 unshaded" in table


def test_missing_buffers_and_a_model_that_does_not_upscale_are_refused(folder: Path, tmp_path: Path) -> None:
    plain = Shot.open(folder)
    with ShotWriter(tmp_path / "bare", name="bare", display_size=DISPLAY, frame_rate=24) as writer:
        item = plain.read(0)
        writer.write(replace(item.frame, gbuffer=None), reference=item.reference)
    with pytest.raises(ShotError, match="frames have no base_color, normal at render size"):
        measure_extrapolation(Shot.open(tmp_path / "bare"), ["taau"], ["guided-warp"], ["1:1"])
    with pytest.raises(ArgumentError, match="--methods"):
        measure_extrapolation(plain, ["guided-warp"], ["guided-warp"], ["1:1"])


def test_an_upscaler_may_have_its_own_graph_for_extrapolated_frames(folder: Path, tmp_path: Path) -> None:
    joint = str(joint_folder(tmp_path / "joint"))
    found = measure_extrapolation(Shot.open(folder), ["classifier:fp32", joint], ["guided-warp"], ["1:1"])
    by_way = {s.method: s.summary(warm=False)["psnr"] for s in found["1:1"]}
    for way in ("shaded", "warp", "warp, filled"):
        assert by_way[f"{joint}, {way}"] == pytest.approx(by_way[f"classifier:fp32, {way}"], abs=0.01)
    assert by_way[f"{joint}, guided-warp"] < by_way["classifier:fp32, guided-warp"] - 1.0  # it is brighter
