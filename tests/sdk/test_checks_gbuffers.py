"""Tests of the thresholds of the G-buffer checks: no warning just below each."""

from typing import Any

import numpy as np
import pytest

from supersampler.errors import FrameError
from supersampler.frame import Float32, Frame
from supersampler.methods.gbuffers import GBUFFERS
from supersampler.validation import FrameChecker

WIDTH, HEIGHT = 80, 60  # all pixels are looked at
PIXELS = WIDTH * HEIGHT


def complaint(
    name: str, array: Float32, depth: Float32 | None = None, jitter: tuple[float, float] = (0.0, 0.0)
) -> str:
    """Return the warning about a frame with this buffer; "" for none."""
    x = np.broadcast_to(np.arange(WIDTH, dtype=np.float32), (HEIGHT, WIDTH))
    place = GBUFFERS[name]
    fields: dict[str, Any] = {place.group: {place.key: array}}
    frame = Frame(
        color=np.full((HEIGHT, WIDTH, 3), 0.4, np.float32),
        depth=(0.1 + 0.004 * x).astype(np.float32) if depth is None else depth,
        motion=np.zeros((HEIGHT, WIDTH, 2), np.float32),
        jitter=jitter,
        **fields,
    )
    try:
        FrameChecker("strict").check(frame, (2 * WIDTH, 2 * HEIGHT), [name])
    except FrameError as found:
        return str(found)
    return ""


def spread(value: float, share: float, fill: float = 0.5) -> Float32:
    """(h, w) of `fill`, a share of it another value."""
    made = np.full(PIXELS, fill, np.float32)
    made[: round(share * PIXELS)] = value
    return made.reshape(HEIGHT, WIDTH)


@pytest.mark.parametrize(("value", "share", "found"), [
    (1.0, 1.0, False), (0.0, 1.0, False), (1.0005, 1.0, False), (-0.0005, 1.0, False),
    (1.002, 0.009, False), (1.002, 0.011, True), (-0.002, 0.011, True),
])  # fmt: skip
def test_fractions_are_in_0_to_1_but_for_a_hundredth(value: float, share: float, found: bool) -> None:
    assert ("outside [0, 1]" in complaint("gbuffer_roughness", spread(value, share))) is found


def test_whole_numbers_are_taken_for_bytes() -> None:
    assert "bytes" in complaint("gbuffer_metallic", spread(255.0, 0.5, fill=0.0))
    assert "bytes" in complaint("gbuffer_metallic", spread(3.0, 0.5, fill=0.0))
    assert "bytes" not in complaint("gbuffer_metallic", spread(2.5, 0.5, fill=0.0))
    assert "bytes" not in complaint("gbuffer_metallic", spread(2.0, 0.5, fill=0.0))
    assert "bytes" not in complaint("gbuffer_metallic", spread(-3.0, 0.5, fill=3.0))
    assert "from 0 to 255" in complaint("gbuffer_metallic", spread(255.0, 0.5, fill=0.0))


def normals(length: float, share: float = 1.0) -> Float32:
    """Normals that face the eye, a share of them of another length; some sky."""
    along = spread(length, share, fill=1.0)
    along[-1] = 0.0
    return np.stack([0 * along, 0.6 * along, 0.8 * along], axis=-1)


@pytest.mark.parametrize(("length", "share", "found"), [
    (1.0, 1.0, False), (1.04, 1.0, False), (0.96, 1.0, False), (0.04, 1.0, False),
    (1.06, 0.5, True), (0.94, 0.5, True), (0.06, 0.5, True), (1.5, 0.009, False), (1.5, 0.011, True),
])  # fmt: skip
def test_normals_are_of_length_1_or_0_but_for_a_twentieth(length: float, share: float, found: bool) -> None:
    assert ("neither 1 nor 0" in complaint("gbuffer_normal", normals(length, share))) is found


def test_infinities_of_both_signs_in_one_pixel_are_reported_without_a_warning_of_numpy() -> None:
    bad = normals(1.0)
    bad[5, 6] = np.inf, -np.inf, 0.0
    assert "first at (x=6, y=5)" in complaint("gbuffer_normal", bad)


def test_normals_in_colours_are_recognised() -> None:
    encoded = 0.5 * normals(1.0) + 0.5
    assert "2 * normal - 1" in complaint("gbuffer_normal", encoded)
    encoded[:20] = 0.0
    assert "2 * normal - 1" in complaint("gbuffer_normal", encoded), "the sky is not encoded"
    shorter = 0.5 * normals(0.8) + 0.5
    assert "2 * normal - 1" not in complaint("gbuffer_normal", shorter)
    assert "neither 1 nor 0" in complaint("gbuffer_normal", shorter)


def doubled(depth: Float32) -> Float32:
    return np.kron(depth, np.ones((2, 2), np.float32))


SLOPE = (0.1 + 0.004 * np.broadcast_to(np.arange(WIDTH), (HEIGHT, WIDTH))).astype(np.float32)


@pytest.mark.parametrize(
    ("scale", "found"), [(1.0, False), (1.2, False), (0.82, False), (1.3, True), (0.78, True)]
)
def test_depth_of_display_size_is_in_the_unit_of_the_frames(scale: float, found: bool) -> None:
    said = complaint("gbuffer_display_depth", (scale * doubled(SLOPE)).astype(np.float32))
    assert ("times frame.depth" in said) is found
    if found:
        assert f"{scale:.3g} times" in said


def test_a_distance_grows_where_depth_falls() -> None:
    assert "a distance: it grows" in complaint("gbuffer_display_depth", np.float32(0.03) / doubled(SLOPE))
    unrelated = np.exp(np.random.default_rng(0).uniform(-0.7, 0.7, SLOPE.shape)).astype(np.float32)
    assert "distance: it" not in complaint("gbuffer_display_depth", np.float32(0.2) * doubled(unrelated))
    flat = np.full((HEIGHT, WIDTH), 0.3, np.float32)
    assert "distance: it" not in complaint("gbuffer_display_depth", np.float32(0.09) / doubled(flat), flat)


def test_depths_are_compared_where_both_have_surfaces() -> None:
    sky = np.where(np.arange(HEIGHT)[:, None] < 40, np.float32(0.0), SLOPE)
    assert complaint("gbuffer_display_depth", doubled(SLOPE), sky) == ""
    assert complaint("gbuffer_display_depth", doubled(sky), SLOPE) == ""
    assert "3 times" in complaint("gbuffer_display_depth", np.float32(3.0) * doubled(SLOPE), sky)


@pytest.mark.parametrize("jitter", [(0.5, 0.0), (0.0, 0.5), (-0.5, -0.5)])
def test_samples_on_the_border_of_a_pixel_are_read_in_the_image(jitter: tuple[float, float]) -> None:
    assert complaint("gbuffer_display_depth", doubled(SLOPE), jitter=jitter) == ""


def test_the_hint_of_a_nan_depends_on_the_buffer() -> None:
    bad = doubled(SLOPE)
    bad[3, 4] = np.nan
    assert "Is it a distance?" in complaint("gbuffer_display_depth", bad)
    assert "Clear the target to 0" in complaint("gbuffer_roughness", spread(np.nan, 0.1))


def test_depth_is_0_at_the_sky_and_never_less() -> None:
    sky = doubled(SLOPE)
    sky[:20] = 0.0
    assert complaint("gbuffer_display_depth", sky) == ""
    sky[5, 7] = -1e-3
    assert "negative, as small as -0.001" in complaint("gbuffer_display_depth", sky)


@pytest.mark.parametrize("jitter", [(0.4, 0.0), (-0.4, 0.0), (0.0, 0.4), (0.0, -0.4)])
def test_depths_are_compared_where_the_samples_lie(jitter: tuple[float, float]) -> None:
    """One of two display pixels has the sample's depth: the one that its jitter's sign puts it in."""
    axis = 0 if jitter[1] else 1
    own = np.arange(2 * (HEIGHT, WIDTH)[axis]) % 2 == int(sum(jitter) > 0.0)
    mask = own[:, None] if axis == 0 else own[None]
    display = np.where(mask, doubled(SLOPE), np.float32(3.0) * doubled(SLOPE)).astype(np.float32)
    assert complaint("gbuffer_display_depth", display, jitter=jitter) == ""
    assert "3 times" in complaint("gbuffer_display_depth", display, jitter=(-jitter[0], -jitter[1]))
