"""Error maps leave out warm-up frames and show the frame of largest error."""

import numpy as np

from supersampler_bench.quality.measure import ScoredImage
from supersampler_bench.report.figures import ErrorMaps


def watch(maps: ErrorMaps, frame: int, *errors: float) -> None:
    for method, error in enumerate(errors):
        flip = np.full((2, 3), error, np.float32)
        maps(ScoredImage(method, frame, np.full((2, 3, 3), frame, np.float32), flip))


def test_the_mean_is_over_the_frames_after_the_warm_up() -> None:
    maps = ErrorMaps(["a", "b"])
    for frame, errors in ((6, (0.9, 0.9)), (7, (0.5, 0.9)), (8, (0.1, 0.3)), (9, (0.2, 0.5))):
        watch(maps, frame, *errors)
    np.testing.assert_allclose([mean[0, 0] for mean in maps.means], [0.15, 0.4])
    assert maps.worst.frame == 9


def test_a_shot_that_ends_during_the_warm_up_has_maps_of_its_warm_up_frames() -> None:
    maps = ErrorMaps(["a"])
    watch(maps, 2, 0.2)
    watch(maps, 3, 0.1)
    np.testing.assert_allclose(maps.means[0], 0.15)
    assert maps.worst.frame == 2
    assert maps.worst.images[0][0, 0, 0] == 2
