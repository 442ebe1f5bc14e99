"""Skipping changes no bit: random rest, motion, light, sizes, masks, cuts and outputs."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from random_cases import random_cases
from rest_scenes import wave
from shared_models import shared_model
from supersampler import Frame, Upscaler, halton_jitter

DISPLAY = (100, 70)
"""More than one tile, and parts of tiles."""
SIZES = ((100, 70), (67, 47))
"""Sizes at ratios 1 and about 1.5: the jitter repeats soon, and so tiles rest soon."""


class Segment(NamedTuple):
    """Some frames in a row.

    `size`: index of the render size; `speed`: of a square, pixels a frame; `light`: of that square; `masked`:
    whether it is reactive; `wants`: outputs beside the image; `cut`: whether the first frame is a cut.
    """

    frames: int
    size: int
    speed: float
    light: float
    masked: bool
    wants: tuple[str, ...]
    cut: bool


SEGMENTS = st.lists(
    st.builds(
        Segment,
        st.sampled_from([1, 2, 9, 25, 45]),
        st.sampled_from([0, 0, 0, 1]),
        st.sampled_from([0.0, 0.0, 0.0, 0.002, 1.3]),
        st.sampled_from([1.0, 1.0, 1.001, 1.5]),
        st.sampled_from([False, False, False, True]),
        st.sampled_from([(), (), ("converged",), ("weight",), ("aovs",)]),
        st.sampled_from([False, False, False, True]),
    ),
    min_size=2,
    max_size=7,
)


def frames(segments: list[Segment]) -> Iterator[tuple[Frame, tuple[str, ...]]]:
    """Yield frames of a pattern with a square in the middle, and the outputs that are asked for."""
    index, place = 0, 30.0
    for segment in segments:
        width, height = SIZES[segment.size]
        ratio = DISPLAY[0] / width
        rows, columns = np.mgrid[:height, :width]
        for first in (True, *[False] * (segment.frames - 1)):
            jitter = halton_jitter(index, ratio)
            x, y = (columns + 0.5 + jitter[0]) * ratio, (rows + 0.5 + jitter[1]) * ratio
            place += segment.speed * ratio
            square = (np.abs(x - place) < 12.0) & (np.abs(y - 30.0) < 9.0)
            color = wave(x, y) * np.where(square, segment.light, 1.0)[..., None]
            motion = np.zeros((height, width, 2), np.float32)
            motion[square, 0] = -segment.speed
            frame = Frame(
                color=color.astype(np.float32),
                depth=np.where(square, 0.5, 0.1).astype(np.float32),
                motion=motion,
                jitter=jitter,
                exposure=1.0,
                reset=index == 0 or (first and segment.cut),
                reactive=square.astype(np.float32) if segment.masked else None,
                aovs=color[..., :1].astype(np.float32),
            )
            yield frame, segment.wants
            index += 1


@random_cases(6)
@given(SEGMENTS, st.sampled_from(["taau", "classifier"]))
def test_skipping_changes_no_bit(segments: list[Segment], method: str) -> None:
    options: dict[str, Any] = {"display_size": DISPLAY, "validate": "off"}
    ours, whole = (
        Upscaler(shared_model(method, "cpu"), **options),
        Upscaler(shared_model(method, "cpu"), skip=False, **options),
    )
    for index, (frame, wanted) in enumerate(frames(segments)):
        mine, theirs = (upscaler.step(frame, outputs=wanted) for upscaler in (ours, whole))
        for name in ("image", *wanted) if wanted else ():
            found, expected = getattr(mine, name), getattr(theirs, name)
            np.testing.assert_array_equal(found, expected, f"{name} of frame {index}")
        if not wanted:
            np.testing.assert_array_equal(mine, theirs, f"frame {index}")
    mine_state, other_state = (upscaler.save_state().history or {} for upscaler in (ours, whole))
    for name, array in mine_state.items():
        np.testing.assert_array_equal(array, other_state[name], name)
