"""`bench skip` measures time, tiles at rest and error of static and of moving scenes."""

from supersampler_bench.timing.skip import MOVES, SkipRecord, frame_count, measure_skipping

RATIO = 1.0  # of the shortest jitter sequence, so of the fewest frames


def test_a_scene_in_which_nothing_moves_is_frozen() -> None:
    frames = []
    results = measure_skipping(
        ["machine_hall"], ["taau"], (96, 64), ratio=RATIO, samples=4, on_frame=lambda: frames.append(1)
    )
    assert len(frames) == len(MOVES) * frame_count(RATIO)
    still, objects, camera = results
    assert [each.moves for each in results] == ["nothing", "objects", "camera"]
    assert still.converged == 1.0
    assert 1.0 > objects.converged >= camera.converged == 0.0
    assert still.psnr > camera.psnr
    table = SkipRecord((96, 64), RATIO, results, frame_count(RATIO)).table()
    assert f"| machine_hall | nothing | taau | {still.milliseconds:.1f} | {still.first:.2f} |" in table
    assert f"{frame_count(RATIO)} frames of test shots" in table
