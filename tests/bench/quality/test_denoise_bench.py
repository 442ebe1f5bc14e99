"""`bench denoise`: ways to denoise a path tracer's frames, against references of some frames."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from noisy_frames import SIZE, noisy, truth
from supersampler import ShotError
from supersampler.denoising.oidn import Guides
from supersampler.frame import Float32
from supersampler.io.images import write_exr
from supersampler.io.shot import Shot, ShotWriter
from supersampler_bench.cli.options import REFERENCES
from supersampler_bench.quality.denoise import measure_render, median_of_three, render_cost
from supersampler_bench.quality.denoise_record import (
    FRAME,
    MEDIAN,
    METHODS,
    ONE_PASS,
    DenoiseRecord,
    RenderRow,
)
from supersampler_bench.quality.denoise_references import (
    bounding_box,
    find_references,
    read_reference,
)
from supersampler_bench.record import DENOISER, age_of
from upscale_runs import refusal, run, succeeded

COUNT = 12
SCORED = (6, 7, 8)


@pytest.fixture
def render(tmp_path: Path) -> Path:
    folder = tmp_path / "wall-4"
    with ShotWriter(folder, name="wall", display_size=SIZE, frame_rate=24.0) as writer:
        for index in range(COUNT):
            writer.write(noisy(index))
    for index in SCORED:
        write_exr(tmp_path / f"wall-reference/{index:04d}.exr", truth(index))
    return folder


class HalfDenoiser:
    """Halves colour, and counts its calls."""

    def __init__(self) -> None:
        self.sizes: list[tuple[int, ...]] = []

    def clean_guides(self, albedo: Float32 | None, normal: Float32 | None) -> Guides:
        return albedo, normal

    def denoise(self, color: Float32, *_: Float32 | None) -> Float32:
        self.sizes.append(color.shape)
        return 0.5 * color


def measured(render: Path, **options: Any) -> RenderRow:
    files = find_references(render, "wall", REFERENCES)
    return measure_render(render, Shot.open(render), files, options.pop("denoiser", None), **options)


def test_the_filter_has_less_error_and_flicker_than_the_frames_and_least_with_two_passes(
    render: Path,
) -> None:
    row = measured(render)
    assert (row.scene, row.samples, row.size) == ("wall", 4, SIZE)
    assert row.reference_frames == list(SCORED)
    assert row.frames == list(range(1, COUNT))  # those within REACH of a frame with a reference
    for name in ("psnr", "tpsnr"):
        single, median, one_pass, both = (
            getattr(row.scores(method), name) for method in (FRAME, MEDIAN, ONE_PASS, DENOISER)
        )
        assert single < median
        assert single < one_pass < both
    assert row.filter_cpu > 0.0
    assert row.frame_cpu == 0.0


def test_each_frame_is_denoised_once_for_all_ways_and_each_mean_once(render: Path) -> None:
    denoiser, frames = HalfDenoiser(), []
    row = measured(render, denoiser=denoiser, on_frame=lambda: frames.append(1))
    assert len(frames) == COUNT - 1
    assert len(denoiser.sizes) == 2 * len(frames)
    assert row.per_frame == "oidn"
    assert not row.reference_is_denoised  # they have no guides
    plain = measured(render)
    assert (row.scores(FRAME).psnr or 0.0) < (plain.scores(FRAME).psnr or 0.0) - 10.0


def test_without_consecutive_references_there_is_no_tpsnr(render: Path) -> None:
    (render.parent / "wall-reference/0007.exr").unlink()
    row = measured(render)
    assert row.scores(DENOISER).tpsnr is None
    assert row.scores(DENOISER).psnr is not None


def test_the_median_ignores_one_outlier_of_three() -> None:
    frames = {index: noisy(index, noise=0.0) for index in range(3)}
    hot = np.array(frames[1].color)
    hot[15, 20] = 100.0
    frames[1] = noisy(1, noise=0.0, color=hot)
    image = median_of_three(frames, 1)
    assert abs(image[15, 20] - truth(1)[15, 20]).max() < 0.1
    np.testing.assert_array_equal(median_of_three({1: frames[1]}, 1), hot)


def test_several_references_of_a_frame_are_averaged(tmp_path: Path) -> None:
    for folder, value in (("a-reference1", 0.25), ("a-reference2", 0.75), ("b-reference1", 9.0)):
        write_exr(tmp_path / folder / "shot_0016.exr", np.full((40, 40, 3), value, np.float32))
    found = find_references(tmp_path / "a-1", "a", REFERENCES)
    assert [path.parent.name for path in found[16]] == ["a-reference1", "a-reference2"]
    reference = read_reference(found[16], None)
    np.testing.assert_allclose(reference.color, 0.5)
    assert bounding_box(reference.scored) == (slice(8, 32), slice(8, 32))


def test_pixels_outside_of_the_rendered_region_are_not_scored(tmp_path: Path) -> None:
    names = [
        *(f"ViewLayer.Combined.{axis}" for axis in "RGBA"),
        *(f"ViewLayer.Denoising Albedo.{axis}" for axis in "RGB"),
        *(f"ViewLayer.Denoising Normal.{axis}" for axis in "XYZ"),
    ]
    image = np.zeros((60, 80, len(names)), np.float32)
    image[10:50, 20:70] = 1.0
    image[20:30, 30:40, :3] = 0.0  # black, with alpha
    write_exr(tmp_path / "0001.exr", image, names)
    denoiser = HalfDenoiser()
    reference = read_reference([tmp_path / "0001.exr"], denoiser)
    assert denoiser.sizes == [(40, 50, 3)]
    assert reference.is_denoised
    assert bounding_box(reference.scored) == (slice(18, 42), slice(28, 62))
    assert reference.scored[18:42, 28:62].all()
    assert reference.color[18, 28].tolist() == [0.5] * 3


def test_the_cost_of_rendering_is_the_mean_over_the_frames_that_are_read(tmp_path: Path) -> None:
    assert render_cost(tmp_path, [1, 2]) is None
    path = tmp_path / "costs.jsonl"
    path.write_text('{"frame": 1, "cpu": 2.0}\n{"frame": 2, "cpu": 4.0}\n\n{"frame": 9, "cpu": 90.0}\n')
    assert render_cost(tmp_path, [1, 2, 3]) == 3.0
    assert render_cost(tmp_path, [5]) is None
    path.write_text('{"frame": 1}\n')
    with pytest.raises(ShotError, match=r"costs\.jsonl"):
        render_cost(tmp_path, [1])


def test_the_command_prints_tables_and_writes_a_record_that_has_the_same_tables(
    render: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (render / "costs.jsonl").write_text('{"frame": 6, "cpu": 2.5}\n')
    path = tmp_path / "denoise.json"
    monkeypatch.chdir(render)
    result = succeeded(run("bench", "denoise", ".", "--per-frame", "none", "--json", path))
    data = json.loads(path.read_text("utf-8"))
    record = DenoiseRecord.from_json(data)
    tables = record.tables("denoise")
    assert [*tables] == ["denoise", "denoise scenes", "denoise flip"]
    for text in tables.values():
        assert text in result.output
    assert "| wall | 4 |" in tables["denoise scenes"]
    assert "| 2.5 |" in tables["denoise scenes"]
    assert data["model_digests"][DENOISER]


def test_ways_are_compared_with_the_denoiser_alone_at_the_same_time(render: Path) -> None:
    def row(samples: int, alone: float, with_filter: float) -> RenderRow:
        psnr = {FRAME: alone, DENOISER: with_filter}
        methods = [replace(base.scores(name), frames_psnr=[psnr.get(name, 0.0)]) for name in METHODS]
        return replace(base, samples=samples, render_cpu=float(samples), mean_cpu=1.0, methods=methods)

    base = replace(measured(render), filter_cpu=0.0, one_pass_cpu=0.0)
    record = DenoiseRecord([row(1, 20.0, 26.0), row(4, 30.0, 35.0)])
    lines = [line for line in record.table().splitlines() if METHODS[DENOISER] in line]
    cells = [[cell.strip() for cell in line.split("|")] for line in lines]
    assert [each[7] for each in cells] == ["1.00", "–"]  # alone, 2 s give 25 dB; none takes 5 s


def test_a_record_is_outdated_if_the_constants_of_the_filter_have_changed(render: Path) -> None:
    record = DenoiseRecord([measured(render)]).to_json()
    assert age_of(record) == ""
    record["model_digests"] = {**record["model_digests"], DENOISER: "other"}
    assert age_of(record).endswith(f"with another version of {DENOISER}.")


@pytest.mark.parametrize(
    ("name", "reference", "message"),
    [
        ("wall", REFERENCES, "SCENE-SAMPLES"),
        ("wall-4", "nothing/*.exr", "--reference"),
        ("wall-4", "late/*.exr", "frames 0 to 11"),
    ],
)
def test_invalid_folder_names_and_references_are_errors(
    render: Path, name: str, reference: str, message: str
) -> None:
    write_exr(render.parent / "late/0100.exr", truth(6))
    folder = render.rename(render.parent / name)
    assert message in refusal("bench", "denoise", folder, "--reference", reference)


def test_a_reference_of_another_size_or_too_small_a_region_is_named(render: Path) -> None:
    path = render.parent / "wall-reference/0007.exr"
    write_exr(path, truth(7, (50, 30)))
    with pytest.raises(ShotError, match="0007"):
        measured(render)
    narrow = np.full((30, 48, 3), np.nan, np.float32)
    narrow[:10] = 1.0
    write_exr(path, narrow)
    with pytest.raises(ShotError, match="larger region"):
        measured(render)
