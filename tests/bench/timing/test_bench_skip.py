"""`bench skip` measures work, time and error of static scenes."""

from supersampler_bench.record import setting
from supersampler_bench.timing.skip import frame_count, markdown_table, measure_skipping, skip_record

RATIO = 1.0  # of the shortest jitter sequence, so of the fewest frames


def test_a_scene_in_which_nothing_moves_is_left_alone_and_looks_as_good() -> None:
    frames = []
    results = measure_skipping(
        ["court"], ["taau"], (96, 64), ratio=RATIO, samples=16, on_frame=lambda: frames.append(1)
    )
    assert len(frames) == 2 * frame_count(RATIO)
    still, moving = results
    assert (still.all_static, moving.all_static) == (True, False)
    assert still.work < moving.work <= 1.0
    assert still.psnr["auto"] > still.psnr["exact"] - 0.1
    record = {**skip_record(results, (96, 64), RATIO), **setting()}
    assert record["scenes"][0]["work"] == still.work
    table = markdown_table(record)
    assert "| court | nothing | taau |" in table
    assert f"the last 16 of {frame_count(RATIO)} frames" in table
