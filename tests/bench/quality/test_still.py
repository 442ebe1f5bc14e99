"""The bench of scenes that stand still compares them with the mean of the samples."""

import numpy as np

from supersampler import halton_jitter
from supersampler.conventions import jitter_phase_count
from supersampler.io.display import decibels, display_transform
from supersampler_bench.quality.still import (
    PERIODS,
    frame_count,
    markdown_table,
    measure_still,
    offline_mean,
    still_record,
)
from supersampler_bench.record import setting
from supersampler_model.data.scenes.still_life import still_scene


def test_the_offline_mean_of_one_period_is_far_better_than_one_frame() -> None:
    scene, ratio, display = still_scene(), 2.0, (320, 180)
    count = jitter_phase_count(ratio)
    frames = [scene.frame(1, (160, 90), halton_jitter(i, ratio)) for i in range(count)]
    truth = display_transform(scene.truth(0, display))
    error = display_transform(offline_mean(frames, display)) - truth
    assert 46.0 < decibels(float(np.mean(error**2))) < 49.0


def test_scores_have_all_periods_and_the_table_names_what_was_measured() -> None:
    stepped = []
    results = measure_still(
        ["analytic", "analytic-mover"], ["taau"], (96, 54), ratios=[1.0], on_frame=lambda: stepped.append(1)
    )
    assert len(stepped) == 2 * frame_count(1.0)
    still, mover = results
    assert len(still.psnr) == len(mover.psnr) == len(PERIODS)
    assert still.best > still.psnr[-1]
    table = markdown_table({**still_record(results, (96, 54), "cpu", "auto"), **setting()})
    assert "| analytic-mover | 1 | taau |" in table
    assert "after 4" in table
