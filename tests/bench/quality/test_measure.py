"""`measure_quality` on small analytic shots, written to disk and read back."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from supersampler import Frame, ShotError, StepResult, upscale_sequence
from supersampler.frame import Float32
from supersampler.io.display import CEILING_DB, auto_exposure, display_transform
from supersampler.io.shot import ClassMaps, Shot, ShotWriter
from supersampler_bench.quality import measure as quality
from supersampler_bench.quality import metrics
from supersampler_bench.quality.measure import measure_quality
from supersampler_bench.quality.scores import (
    BORDER,
    FRAME_METRICS,
    MASKED,
    FrameScores,
    MethodRow,
    MethodScores,
)
from supersampler_model.data.scenes.analytic import DiscOverPlane

RENDER, DISPLAY = (48, 27), (96, 54)
SCENE = DiscOverPlane()


def write_shot(
    folder: Path,
    *,
    references: Sequence[int],
    cuts: Sequence[int] = (0,),
    count: int = 6,
    classes: ClassMaps | None = None,
) -> Shot:
    with ShotWriter(folder, name="disc", display_size=DISPLAY, frame_rate=30) as writer:
        for index in range(count):
            jitter = (0.25, -0.25) if index % 2 else (-0.25, 0.25)
            frame = replace(SCENE.frame(index, RENDER, jitter), reset=index in cuts)
            known = (truth(index), classes) if index in references else (None, None)
            writer.write(frame, reference=known[0], classes=known[1])
    return Shot.open(folder)


class Painter:
    """Stands where an Upscaler would and paints by a function of the frame's number, to test the measure."""

    def __init__(self, paint: Callable[[int], Float32]) -> None:
        self.paint, self.number = paint, -1
        self.model = SimpleNamespace(info=SimpleNamespace(maps={}, gbuffers=()))

    def __call__(self, *_: Any, **__: Any) -> "Painter":
        return self

    def step(self, _: Frame, **__: Any) -> Float32:
        self.number += 1
        return np.asarray(self.paint(self.number), np.float32)


def write_variants(folder: Path, *, native_count: int = 6, native_pre_exposure: float = 1.0) -> Shot:
    """Write a shot of six frames at ratios 2 and 1, and return the first."""
    for name, size in (("2x", RENDER), ("1x", DISPLAY)):
        settings: dict[str, Any] = {"display_size": DISPLAY, "frame_rate": 30, "variant": name}
        with ShotWriter(folder, name="disc", **settings) as writer:
            for index in range(6 if name == "2x" else native_count):
                frame = SCENE.frame(index, size, (0.2, -0.1))
                if name == "1x":
                    color = np.asarray(frame.color) * np.float32(native_pre_exposure)
                    frame = replace(frame, color=color, pre_exposure=native_pre_exposure)
                writer.write(frame, reference=truth(index), shared=name == "1x")
    return Shot.open(folder / "2x.json")


def truth(index: int) -> Float32:
    return SCENE.truth(index, DISPLAY, samples=4)


Painted = Callable[[Shot, Callable[[int], Float32]], list[FrameScores]]


@pytest.fixture
def painted(monkeypatch: pytest.MonkeyPatch) -> Painted:
    """Measure the images that a function of the frame's number paints."""

    def measured(shot: Shot, paint: Callable[[int], Float32]) -> list[FrameScores]:
        monkeypatch.setattr(quality, "Upscaler", Painter(paint))
        return measure_quality(shot, ["painter"])[0].frames

    return measured


def test_a_perfect_image_has_perfect_scores(tmp_path: Path, painted: Painted) -> None:
    hard = ClassMaps(*(np.arange(54 * 96).reshape(54, 96).astype(np.uint8) // step % 3 for step in (1, 3, 7)))
    shot = write_shot(tmp_path, references=[2, 4, 5], classes=hard)
    stored = {item.index: item.reference for item in shot if item.reference is not None}
    frames = painted(shot, lambda i: stored.get(i, truth(i)))
    assert [f.frame for f in frames] == [2, 4, 5]
    for scores in (frames[-1].full, frames[-1].cropped):
        perfect = {"flip": 0.0, "ssim": 1.0, "warped_error_difference": 0.0, "strred": 0.0}
        assert scores == {
            name: pytest.approx(perfect.get(name, CEILING_DB))
            if name in FRAME_METRICS
            else pytest.approx(scores[name])
            for name in scores
        }


@pytest.mark.parametrize(("references", "cuts"), [([2, 4, 5], (0,)), ([2, 3, 4], (0, 3))])
def test_change_is_measured_only_between_neighbours_of_one_cut_that_both_have_a_reference(
    tmp_path: Path, painted: Painted, references: list[int], cuts: tuple[int, ...]
) -> None:
    frames = painted(write_shot(tmp_path, cuts=cuts, references=references), truth)
    for name in ("tpsnr", "warped_error_difference"):
        assert [np.isnan(f.full[name]) for f in frames] == [True, True, False]


def test_an_image_that_lags_a_frame_is_worse_where_it_moves_and_steady_noise_is_not_flicker(
    tmp_path: Path, painted: Painted
) -> None:
    shot = write_shot(tmp_path, references=[4, 5])
    late = painted(shot, lambda i: truth(i - 1) if i else truth(0))[-1].cropped
    stain = np.random.default_rng(0).uniform(0.9, 1.1, (DISPLAY[1], DISPLAY[0], 3)).astype(np.float32)
    stained = painted(shot, lambda i: truth(i) * stain)[-1].cropped
    assert late["psnr"] < stained["psnr"] - 5
    assert late["tpsnr"] < stained["tpsnr"] - 5


def test_the_masks_are_those_of_the_scene(tmp_path: Path, painted: Painted) -> None:
    shot = write_shot(tmp_path, references=[3])
    unshaded = SCENE.disoccluded(3, DISPLAY)
    wrong_there = painted(shot, lambda i: np.where(unshaded[..., None], 0, truth(i)))[0].full
    assert 0.7 * unshaded.sum() < wrong_there["pixels_disoccluded"] < 1.3 * unshaded.sum()
    assert wrong_there["psnr_disoccluded"] < wrong_there["psnr"] - 6
    moving_share = wrong_there["pixels_moving"] / (DISPLAY[0] * DISPLAY[1])
    disc_share = np.pi * 8**2 / (64 * 36)  # moves by 0.84 render pixels; the background by 0.38
    assert moving_share == pytest.approx(disc_share, rel=0.1)


def test_the_masks_are_the_truth_classes_where_a_shot_has_them(tmp_path: Path, painted: Painted) -> None:
    ghost, alias = (np.zeros((DISPLAY[1], DISPLAY[0]), np.uint8) for _ in range(2))
    ghost[20:22, 30:40], ghost[30:33, 30:40], alias[40:42, 30:40], alias[42:46, 30:40] = 1, 2, 1, 2
    shot = write_shot(tmp_path, references=[3], classes=ClassMaps(ghost, alias))
    wrong = painted(shot, lambda i: np.where((ghost == 2)[..., None], 0, truth(i)))[0].full
    pixels = {name: wrong[f"pixels_{name}"] for name in ("disoccluded", "changing_light", "aliased")}
    assert pixels == {"disoccluded": 20, "changing_light": 30, "aliased": 60}
    assert wrong["psnr_changing_light"] < 20 < 60 < wrong["psnr_disoccluded"]
    assert wrong["psnr_aliased"] > 60


def test_thin_pixels_are_measured_where_their_class_is_known(tmp_path: Path, painted: Painted) -> None:
    none, thin = (np.zeros((DISPLAY[1], DISPLAY[0]), np.uint8) for _ in range(2))
    thin[20:22, 30:40] = 1
    scores = {}
    for name, known in (("with", thin), ("without", None)):
        shot = write_shot(tmp_path / name, references=[3], classes=ClassMaps(none, none, known))
        scores[name] = painted(shot, lambda i: np.where(thin[..., None], 0, truth(i)))[0].full
    assert scores["with"]["pixels_thin"] == 20
    assert scores["with"]["psnr_thin"] < 20 < scores["with"]["psnr"]
    assert np.isnan(scores["without"]["psnr_thin"])


def test_without_truth_classes_aliasing_and_changing_light_are_not_measured(
    tmp_path: Path, painted: Painted
) -> None:
    scores = painted(write_shot(tmp_path, references=[3]), truth)[0].full
    assert np.isnan([scores["psnr_changing_light"], scores["psnr_aliased"]]).all()
    assert scores["pixels_aliased"] == 0


def test_strred_uses_pairs_that_do_not_overlap(tmp_path: Path, painted: Painted) -> None:
    shot = write_shot(tmp_path, references=[1, 2, 3, 4, 5, 8, 9], count=10)
    frames = painted(shot, lambda i: truth(i - i % 2))
    paired = [f.frame for f in frames if not np.isnan(f.cropped["strred"])]
    assert paired == [2, 4, 9]
    assert all(f.full["trred"] > 0.0 for f in frames if f.frame in paired)


def test_predicted_classes_are_compared_with_the_true_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ghost, alias = (np.zeros((DISPLAY[1], DISPLAY[0]), np.uint8) for _ in range(2))
    ghost[20:22, 30:40] = 1
    classes = np.zeros((DISPLAY[1] // 2, DISPLAY[0] // 2, 6), np.float32)
    classes[..., 0], classes[..., 5] = 0.5, 1.0
    classes[10, 15:18, 1] = 0.9

    class Teller(Painter):
        def __init__(self) -> None:
            super().__init__(truth)
            self.model.info.maps["class_map"] = None

        def step(self, _: Frame, **asked: Any) -> StepResult:  # type: ignore[override]
            assert asked == {"outputs": ["class_map"]}
            return StepResult(super().step(_), class_map=classes)

    monkeypatch.setattr(quality, "Upscaler", Teller())
    [result] = measure_quality(write_shot(tmp_path, references=[3], classes=ClassMaps(ghost, alias)), ["t"])
    counts = result.classes(warm=False, cropped=False)
    assert counts is not None
    of_ghosting, of_aliasing = counts
    assert of_ghosting[1].tolist() == [8, 12, 0]
    assert of_aliasing.tolist() == [[0, 0, 96 * 54], [0, 0, 0], [0, 0, 0]]
    assert result.classes() is None  # no frame after the warm-up
    cropped = result.frames[0].cropped_classes
    assert cropped is not None
    assert cropped.sum() == 2 * 80 * 38


def test_the_border_is_left_out_of_the_cropped_scores(tmp_path: Path, painted: Painted) -> None:
    shot = write_shot(tmp_path, references=[4, 5])

    def framed(index: int) -> Float32:
        image = truth(index) * (index % 2)
        metrics.crop(image, BORDER)[...] = metrics.crop(truth(index), BORDER)
        return image

    scores = painted(shot, framed)[-1]
    assert scores.cropped["psnr"] > 60 > 30 > painted(shot, framed)[0].full["psnr"]
    assert scores.cropped["tpsnr"] > 60 > scores.full["tpsnr"]


def test_output_and_reference_have_the_same_exposure(tmp_path: Path, painted: Painted) -> None:
    shot = write_shot(tmp_path, references=[4])
    too_bright = painted(shot, lambda i: 2 * truth(i))[0].full
    assert too_bright["psnr"] < 25  # metered each on its own, they would be equal


def test_pre_exposure_changes_no_score(tmp_path: Path) -> None:
    """A shot whose frames and references have other factors has the scores of one without."""
    methods, found = ["taau", "easu-rcas", "fsr2-like"], []
    for name, factors in (("plain", (1.0, 1.0, 1.0)), ("exposed", (2.0, 0.25, 8.0))):
        with ShotWriter(tmp_path / name, name="disc", display_size=DISPLAY, frame_rate=30) as writer:
            for index, factor in enumerate(factors):
                frame = SCENE.frame(index, RENDER, (0.25, -0.25))
                color = factor * np.asarray(frame.color)
                given = replace(frame, color=color, exposure=0.7, pre_exposure=factor)
                writer.write(given, reference=factor * truth(index))
        found.append(measure_quality(Shot.open(tmp_path / name), methods))
    for plain, exposed in zip(*found, strict=True):
        summaries = [scores.summary(warm=False) for scores in (plain, exposed)]
        assert summaries[1] == pytest.approx(summaries[0], rel=1e-4, nan_ok=True), plain.method


def test_a_shot_without_references_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ShotError, match="no frame has a reference to measure against"):
        measure_quality(write_shot(tmp_path, references=[]), ["bilinear"])


def test_a_reference_with_missing_pixels_is_refused(tmp_path: Path) -> None:
    with ShotWriter(tmp_path, name="disc", display_size=DISPLAY, frame_rate=30) as writer:
        reference = truth(0)
        reference[5, 7:9, 1] = np.nan
        writer.write(SCENE.frame(0, RENDER, (0.0, 0.0)), reference=reference)
    with pytest.raises(ShotError, match="the reference of frame 0 has 2 pixels of NaN"):
        measure_quality(Shot.open(tmp_path), ["bilinear"])


def scores_of(frame: int, psnr: float, pixels: float) -> FrameScores:
    scores = dict.fromkeys(FRAME_METRICS, float("nan"))
    scores |= {"psnr": psnr, "psnr_moving": psnr if pixels else float("nan"), "pixels_moving": pixels}
    scores |= dict.fromkeys((f"pixels_{name}" for name in MASKED if name != "moving"), 0.0)
    scores |= {"srred": psnr, "trred": 2.0 if pixels else float("nan")}
    return FrameScores(frame, full=scores, cropped={**scores, "psnr": psnr + 1})


def test_a_summary_is_the_mean_over_frames_and_in_masks_over_pixels() -> None:
    result = MethodScores("m", [scores_of(0, 10, 5), scores_of(8, 20, 900), scores_of(9, 30, 100)])
    assert result.summary()["psnr"] == pytest.approx(26)
    assert result.summary(cropped=False)["psnr"] == pytest.approx(25)
    assert result.summary(warm=False, cropped=False)["psnr"] == pytest.approx(20)
    pooled = -10 * np.log10(0.9 * 10**-2 + 0.1 * 10**-3)
    assert result.summary()["psnr_moving"] == pytest.approx(pooled)
    assert np.isnan(result.summary()["psnr_disoccluded"])
    assert np.isnan(result.summary()["tpsnr"])
    assert result.summary()["strred"] == pytest.approx(25 * 2)


def test_the_mean_of_shots_has_equal_weights_and_skips_shots_without_the_metric() -> None:
    long = MethodScores("m", [scores_of(frame, 20, 0) for frame in (8, 9, 10)])
    short = MethodScores("m", [scores_of(8, 30, 10)])
    mean = MethodRow.mean([MethodRow.of(long), MethodRow.of(short)]).summary["warm_full"]
    assert mean["psnr"] == pytest.approx(25)
    assert mean["psnr_moving"] == pytest.approx(30)
    assert np.isnan(mean["tpsnr"] or 0.0)


def test_real_methods_run_side_by_side_and_repeat_exactly(tmp_path: Path) -> None:
    shot = write_shot(tmp_path, references=[3, 4])
    done: list[bool] = []
    first = measure_quality(shot, ["bilinear", "taau"], on_frame=lambda: done.append(True))
    assert len(done) == 6
    assert [result.method for result in first] == ["bilinear", "taau"]
    assert all(15 < frame.full["psnr"] < 50 for result in first for frame in result.frames)
    alone = measure_quality(shot, ["taau:fp32"])
    np.testing.assert_equal(alone[0].summary(warm=False), first[1].summary(warm=False))


def test_the_first_image_of_a_shot_has_no_history_whether_or_not_it_is_marked_as_a_cut(
    tmp_path: Path,
) -> None:
    shot = write_shot(tmp_path, cuts=(), references=[0, 1], count=2)
    [scores] = measure_quality(shot, ["bilinear"])
    assert ["psnr_first" in frame.cropped for frame in scores.frames] == [True, False]


def test_a_native_method_steps_the_frames_of_display_size(tmp_path: Path) -> None:
    shot = write_variants(tmp_path / "shot")
    names = ["taa", "taa:native", "easu:native"]
    assert quality.runnable(shot, names, pytest.fail) == names
    small, native = measure_quality(shot, ["taa", "taa:native"])
    [alone] = measure_quality(Shot.open(tmp_path / "shot" / "1x.json"), ["taa"])
    assert native.method == "taa:native"
    found, want, of_small = (scores.summary(warm=False) for scores in (native, alone, small))
    assert all(found[name] == want[name] for name in ("psnr", "ssim", "flip", "tpsnr"))
    assert found["psnr"] > of_small["psnr"] + 1.0


def test_frames_of_display_size_may_have_another_pre_exposure(tmp_path: Path) -> None:
    [plain] = measure_quality(write_variants(tmp_path / "plain"), ["taa:native"])
    exposed = write_variants(tmp_path / "exposed", native_pre_exposure=2.0)
    [scores] = measure_quality(exposed, ["taa:native"])
    assert scores.summary(warm=False) == pytest.approx(plain.summary(warm=False), nan_ok=True)


def test_a_native_method_needs_each_frame_at_display_size(tmp_path: Path) -> None:
    shot = write_shot(tmp_path / "none", references=[1])
    with pytest.raises(ShotError, match=r"no frames of display size: there is no 1x\.json"):
        measure_quality(shot, ["taa:native"])
    with pytest.raises(ShotError, match=r"1x\.json: has 4 frames, 2x\.json has 6"):
        measure_quality(write_variants(tmp_path / "some", native_count=4), ["taa:native"])


def test_two_passes_have_a_row_of_their_own(tmp_path: Path) -> None:
    shot = write_shot(tmp_path, references=[1, 2, 5])
    one, two = measure_quality(shot, ["taau", "taau:x2"])
    assert two.method == "taau:x2"
    images = list(upscale_sequence(shot, display_size=DISPLAY, model="taau", validate="off"))
    stored = {item.index: item.reference for item in shot}
    exposures = {item.index: item.frame.exposure for item in shot}
    for scores in two.frames:
        reference = stored[scores.frame]
        assert reference is not None
        exposure = exposures[scores.frame] or auto_exposure(reference)
        shown = display_transform(images[scores.frame], exposure)
        assert scores.full["psnr"] == pytest.approx(
            metrics.psnr(shown, display_transform(reference, exposure))
        )
    assert [f.full["psnr"] for f in one.frames] != [f.full["psnr"] for f in two.frames]
