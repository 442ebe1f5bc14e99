"""The oracle blends frame and history as well as the reference allows."""

import numpy as np

from studies.oracle import Oracle
from supersampler import Shot, Upscaler
from supersampler.io.display import display_transform
from supersampler_bench.quality.measure import reference_size


def test_no_method_that_blends_frame_and_history_is_nearer_to_the_reference() -> None:
    shot = Shot.open("plaza")
    display, first = reference_size(shot), shot.reference_indices[0]
    oracle, method = Oracle(display), Upscaler("taau", display_size=display, threads=1)
    errors = []
    for item in shot.frames(first, first + 4):
        assert item.reference is not None
        images = item.reference.astype(np.float32), oracle.step(item), method.step(item.frame)
        truth, *shown = (display_transform(image, item.frame.exposure or 1.0) for image in images)
        errors.append([float(np.square(image - truth).mean()) for image in shown])
    assert all(best < 0.8 * other for best, other in errors[1:]), errors
