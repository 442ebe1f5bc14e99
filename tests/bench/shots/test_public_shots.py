"""Test shots are rendered once, opened only when complete, and identified by the hash of their pixels."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from supersampler import ShotError
from supersampler.io.files import FolderLock
from supersampler.io.images import read_exr, write_exr
from supersampler.io.shot import Shot, copy_shot
from supersampler_bench.quality.score_table import QualityRecord
from supersampler_bench.shots import public_shots
from supersampler_bench.shots.public_shots import (
    PublicShot,
    TestShots,
    default_cache,
    freeze,
    open_test_shots,
    pixel_hash,
)
from supersampler_bench.shots.rendering import frames_there, render_test_shot, render_test_shots
from supersampler_model.data.errors import DataError
from supersampler_model.data.sequences import APART_FAMILIES, TEST_FAMILIES
from upscale_runs import refusal, run, succeeded

TINY = TestShots(
    seeds={"gallery": 5, "court": 3}, frames=10, display_size=(48, 28), ratios=(1.5, 2.0), samples=4
)

TINY_APART = replace(TINY, seeds={"rigging": 113}, thin=True)
TINY_CORNERS = replace(TINY, seeds={"thin_movers": 5}, ratios=(2.0,), truth=True)


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    cache = tmp_path_factory.mktemp("cache")
    seen: list[bool] = []
    render_test_shots(cache, TINY, workers=2, on_frame=lambda: seen.append(True))
    assert len(seen) == frames_there(cache, TINY) == 20
    for apart in (TINY_APART, TINY_CORNERS):
        render_test_shots(cache, apart)
    return cache


@pytest.fixture(scope="module")
def opened(cache: Path) -> list[PublicShot]:
    return open_test_shots(cache, TINY.ratios, TINY, cache / "none.json")


def test_there_is_one_test_shot_of_each_family_that_is_never_trained_on() -> None:
    assert set(public_shots.TEST_SHOTS.seeds) == set(TEST_FAMILIES)
    assert sorted(public_shots.TEST_SHOTS.ratios) == [1.0, 1.5, 2.0, 3.0, 4.0]
    assert public_shots.TEST_SHOTS.samples >= 64


def test_shots_apart_are_of_families_apart_and_in_no_mean() -> None:
    apart = public_shots.APART_SHOTS
    assert {name for shots in apart for name in shots.seeds} == set(APART_FAMILIES)
    for name in ("display_size", "samples"):
        assert {getattr(shots, name) for shots in apart} == {getattr(public_shots.TEST_SHOTS, name)}
    assert public_shots.shots_named("test-shots") == public_shots.TEST_SHOTS
    assert public_shots.shots_named("rigging") == public_shots.RIGGING_SHOT
    one = public_shots.shots_named("moving_shadows")
    assert one is not None
    assert (list(one.seeds), one.truth) == (["moving_shadows"], True)
    assert public_shots.shots_named("plaza") is None


@pytest.mark.long  # renders shots
def test_only_shots_apart_have_a_class_of_thin_pixels(cache: Path, opened: list[PublicShot]) -> None:
    [apart] = open_test_shots(cache, [2.0], TINY_APART, cache / "none.json")
    classes, others = apart.shot.read_classes(4), opened[0].shot.read_classes(4)
    assert classes is not None
    assert classes.thin is not None
    assert 0.02 < classes.thin.mean() < 0.7
    assert others is not None
    assert others.thin is None


def test_only_corner_shots_have_planes_of_truth_and_their_aovs(cache: Path, opened: list[PublicShot]) -> None:
    [corners] = open_test_shots(cache, [2.0], TINY_CORNERS, cache / "none.json")
    planes, frame = corners.shot.read_truth(4), corners.shot.read(4).frame
    assert set(planes) == {"thin_still", "thin_moving", "moving", "unshadowed"}
    assert corners.shot.info.aov_names == ("thin_still", "thin_moving")
    assert frame.aovs is not None
    assert set(np.unique(frame.aovs)) == {0.0, 1.0}
    assert frame.aovs.mean() == pytest.approx(
        (planes["thin_still"] + planes["thin_moving"]).mean() / 2, abs=0.01
    )
    assert 0.5 < planes["unshadowed"].mean() < 1.0
    assert opened[0].shot.read_truth(4) == {}


def test_each_frame_has_its_reference_classes_and_both_g_buffers(opened: list[PublicShot]) -> None:
    assert [(o.shot.name, o.ratio, o.shot.render_size) for o in opened] == [
        ("gallery", 1.5, (32, 19)), ("court", 1.5, (32, 19)), ("gallery", 2.0, (24, 14)),
        ("court", 2.0, (24, 14)),
    ]  # fmt: skip
    for item in opened[3].shot:
        assert item.reference is not None
        assert opened[3].shot.read_classes(item.index) is not None
        assert item.frame.gbuffer is not None
        assert item.frame.gbuffer_display is not None
        assert {*item.frame.gbuffer, "depth"} == {*item.frame.gbuffer_display}


def test_a_second_run_renders_nothing_and_another_driver_is_refused(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    generations = {path: path.stat().st_mtime_ns for path in cache.rglob("*.exr")}
    render_test_shots(cache, TINY)
    assert {path: path.stat().st_mtime_ns for path in cache.rglob("*.exr")} == generations
    monkeypatch.setattr("supersampler_bench.shots.rendering.driver_name", lambda _: "another")
    with pytest.raises(ShotError, match=r"court: the existing shot has the driver .*run's is another"):
        render_test_shot(cache, TINY, "court")


def test_two_runs_do_not_render_into_one_cache_at_once(tmp_path: Path) -> None:
    (tmp_path / "test-shots").mkdir()
    with FolderLock(tmp_path / "test-shots"), pytest.raises(ShotError, match="another run writes to it"):
        render_test_shots(tmp_path, TINY)


def test_a_worker_reports_its_errors(cache: Path) -> None:
    with pytest.raises(DataError, match=r"has the samples 4; this run's is 9\. Delete the folder"):
        render_test_shots(cache, replace(TINY, samples=9))


@pytest.mark.parametrize("channel", ["R", "class.alias", "class.thin", "truth.moving"])
def test_the_hash_is_of_pixels_and_not_of_files(cache: Path, tmp_path: Path, channel: str) -> None:
    shots = TINY_CORNERS if channel.startswith("truth") else TINY_APART
    [opened] = open_test_shots(cache, [2.0], shots, cache / "none.json")
    copy = copy_shot(opened.shot, tmp_path / "copy")
    assert pixel_hash(copy) == opened.digest
    path = tmp_path / "copy" / "reference" / "0004.exr"
    channels = read_exr(path)
    write_exr(path, {**channels, channel: np.roll(channels[channel], 5, axis=0)})
    assert pixel_hash(copy) != opened.digest


def test_shots_matching_the_frozen_hashes_are_recognised_and_others_warned_of(
    tmp_path: Path, cache: Path, opened: list[PublicShot]
) -> None:
    assert "no hash is frozen for it" in (opened[0].warning() or "")
    file = tmp_path / "frozen.json"
    freeze(opened, file)
    again = open_test_shots(cache, TINY.ratios, TINY, file)
    assert [(shot.as_frozen, shot.warning()) for shot in again] == [(True, None)] * 4
    changed = replace(again[1], digest="0" * 64)
    assert not changed.origin()["as_frozen"]
    assert "court at 1.5x: its pixels are not the frozen ones" in (changed.warning() or "")
    elsewhere = replace(changed, driver="a GPU")
    assert "rendered by a GPU, the frozen pixels by" in (elsewhere.warning() or "")
    with pytest.raises(ShotError, match=r"rendered by a GPU and .*One must render them all"):
        freeze([again[0], elsewhere], file)


def test_errors_of_missing_or_incomplete_shots_name_the_command(tmp_path: Path, cache: Path) -> None:
    none = tmp_path / "none.json"
    with pytest.raises(ShotError, match=r"gallery at ratio 2 is not there\. `supersampler bench shots`"):
        open_test_shots(tmp_path, [2.0], TINY, none)
    with pytest.raises(ShotError, match=r"no test shot has the ratio 1\.7\. They are made at 1\.5, 2"):
        open_test_shots(cache, [1.7], TINY, none)
    with pytest.raises(ShotError, match=r"is of another version of the test shots\. Delete"):
        open_test_shots(cache, [2.0], replace(TINY, frames=11), none)


def test_a_shot_without_provenance_is_refused_when_it_is_opened_and_rendered(
    cache: Path, tmp_path: Path
) -> None:
    shutil.copytree(cache, tmp_path / "old")
    court = tmp_path / "old" / "test-shots" / "court"
    (court / "provenance.json").rename(court / "drawn.json")
    refused = pytest.raises(
        ShotError, match=r"provenance\.json: is missing: .*earlier version\. Delete .*court"
    )
    with refused:
        open_test_shots(tmp_path / "old", [2.0], TINY, tmp_path / "none.json")
    with refused:
        render_test_shot(tmp_path / "old", TINY, "court")


def test_the_cache_is_in_the_cache_folder_of_the_platform(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    for variable in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(variable, raising=False)
    for platform, folder in (
        ("linux", ".cache/supersampler"),
        ("darwin", "Library/Caches/supersampler"),
        ("win32", "AppData/Local/supersampler"),
    ):
        monkeypatch.setattr("sys.platform", platform)
        assert default_cache() == tmp_path / folder
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "other"))
    assert default_cache() == tmp_path / "other" / "supersampler"


def test_the_bench_measures_all_test_shots_and_their_mean(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(public_shots, "TEST_SHOTS", TINY)
    monkeypatch.setattr(public_shots, "APART_SHOTS", (TINY_APART,))
    monkeypatch.setattr(public_shots, "FROZEN", tmp_path / "frozen.json")
    monkeypatch.setenv(public_shots.CACHE_VARIABLE, str(cache))
    shots = succeeded(run("bench", "shots", "--freeze"))
    assert shots.stdout.count("yes") == 6
    values = tmp_path / "values.json"
    command = ["bench", "quality", "test-shots", "--ratio", "1.5,2", "--methods", "bilinear,taau"]
    done = succeeded(run(*command, "--json", values))
    assert done.stderr == ""
    record = json.loads(values.read_text(encoding="utf-8"))
    assert [(s["name"], s["ratio"], s["as_frozen"]) for s in record["shots"]] == [
        ("gallery", 1.5, True), ("court", 1.5, True), ("gallery", 2.0, True), ("court", 2.0, True),
    ]  # fmt: skip
    assert {s["masks"] for s in record["shots"]} == {"truth classes"}
    of_shots = [s["methods"][1]["summary"]["all_full"]["psnr"] for s in record["shots"][:2]]
    mean = record["means"][1]
    assert (mean["ratio"], mean["method"]) == (1.5, "taau")
    assert mean["summary"]["all_full"]["psnr"] == pytest.approx(np.mean(of_shots))
    text = QualityRecord.from_json(record).tables("quality test-shots")["quality test-shots"]
    assert text.count("| taau |") == 2  # the means
    assert "Mean of the shots gallery, court at ratio 1.5 to 48x28: 10 frames each" in text
    assert "thin" not in text
    apart = ["bench", "quality", "rigging", "--methods", "bilinear,taau", "--json", str(values)]
    done = run(*apart)
    assert (done.exit_code, done.stderr) == (0, "")
    [shot] = json.loads(values.read_text(encoding="utf-8"))["shots"]
    assert (shot["name"], shot["ratio"], shot["as_frozen"]) == ("rigging", 2.0, True)
    assert shot["methods"][1]["summary"]["all_full"]["psnr_thin"] > 10.0


def test_the_bench_without_a_cache_names_the_command_that_makes_one(tmp_path: Path) -> None:
    done = run("bench", "quality", "test-shots", "--cache", tmp_path)
    assert done.exit_code == 1
    assert done.stderr.count("\n") == 1
    assert "`supersampler bench shots` renders it" in done.stderr
    wrong = run("bench", "quality", "test-shots", "--ratio", "half")
    assert "--ratio is 'half'; want numbers" in wrong.stderr


@pytest.mark.parametrize("command", ["quality", "extrapolation"])
def test_a_ratio_for_a_shot_that_has_its_own_is_refused(command: str) -> None:
    said = refusal("bench", command, "plaza", "--ratio", "3")
    assert "--ratio is '3'; want none: plaza is no test shot, and has its own." in said


def test_one_command_renders_the_shipped_shot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("supersampler_model.data.product_shot.DISPLAY_SIZE", (32, 18))
    monkeypatch.setattr("supersampler_model.data.product_shot.FRAMES", 13)
    succeeded(run("bench", "product-shot", tmp_path / "plaza"))
    shot = Shot.open(tmp_path / "plaza")
    assert (shot.name, shot.render_size, len(shot), shot.reference_indices) == (
        "plaza",
        (16, 9),
        13,
        [11, 12],
    )
    assert shot.read_classes(12) is not None
    shipped = Shot.open("plaza")
    assert [shot.read_raw(i).jitter for i in range(13)] == [shipped.read_raw(i).jitter for i in range(13)]
    assert shot.info.license == shipped.info.license
