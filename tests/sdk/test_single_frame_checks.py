"""Tests of the checks of a single frame: a mistake is named, and a correct frame just short of it is not."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from plain_frames import HEIGHT, WIDTH, complaints, plain_frame
from supersampler.arguments import ieee_arithmetic
from supersampler.conventions import camera_motion
from supersampler.conventions.encodings import srgb_decoded
from supersampler.errors import FrameWarning
from supersampler.frame import Float32
from supersampler.validation import FrameChecker
from supersampler.validation.probe import GRID_PIXELS, pixel_grid, tone_mapped
from supersampler.validation.single_frame import mixed_edges

PIXELS = WIDTH * HEIGHT
Y, X = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
INDEX = np.arange(PIXELS).reshape(HEIGHT, WIDTH)


def spread(value: float, share: float, fill: Float32) -> Float32:
    """Return `fill`, (h, w, ...), with a share of its pixels at one value."""
    made = fill.copy()
    made.reshape(PIXELS, -1)[: round(share * PIXELS)] = value
    return made


def mixed(light: Float32, depth: Float32) -> float:
    """Return the fraction of mixed edges in luminance."""
    return mixed_edges(tone_mapped(light, light), depth)


def grey(values: NDArray[Any]) -> Float32:
    """Return (h, w, 3) colour of these (h, w) values."""
    return np.repeat(values.astype(np.float32)[..., None], 3, axis=2)


def test_a_plain_frame_is_fine() -> None:
    assert complaints(plain_frame()) == ""


@given(st.tuples(st.integers(1, 20_000), st.integers(1, 4_000)), st.booleans())
def test_the_grid_is_regular_and_covers_any_image(size: tuple[int, int], turned: bool) -> None:
    size = size[::-1] if turned else size
    rows, columns = pixel_grid(size)
    for indices, extent in ((rows, size[1]), (columns, size[0])):
        distinct = np.unique(indices)
        steps = np.unique(np.diff(distinct))
        assert len(steps) <= 1
        assert not len(steps) or max(2 * distinct[0], extent - 1 - distinct[-1]) <= steps[0]
    assert len(rows) == len({*zip(rows.tolist(), columns.tolist(), strict=True)})
    if size[0] * size[1] <= GRID_PIXELS:
        assert len(rows) == size[0] * size[1]
    elif min(size) > 200:
        assert 0.4 * GRID_PIXELS < len(rows) < 1.2 * GRID_PIXELS


@pytest.mark.parametrize("size", [(1, 13_000), (13_000, 1)])
def test_a_frame_of_one_row_or_column_is_fine(size: tuple[int, int]) -> None:
    shape = size[::-1]
    color, motion = np.full((*shape, 3), 0.4, np.float32), np.zeros((*shape, 2), np.float32)
    assert complaints(plain_frame(color=color, depth=np.full(shape, 0.1, np.float32), motion=motion)) == ""


@pytest.mark.parametrize(
    ("field", "channel"), [("color", 0), ("color", 2), ("depth", ...), ("motion", 0), ("motion", 1)]
)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_single_nan_is_found_and_located(field: str, channel: Any, value: float) -> None:
    array = getattr(plain_frame(), field).copy()
    array[7, 5, channel] = value
    said = complaints(plain_frame(**{field: array}))
    assert said.startswith(f"frame.{field} is NaN or Inf in 1 pixels, first at (x=5, y=7)")
    assert len(said.splitlines()) == 1


# --- colour ---


BYTES = np.rint(255 * X / (WIDTH - 1))


def whole_numbers(most: int) -> Float32:
    return grey(INDEX % (most + 1))


PLAIN, EVEN, STEPS = grey(0.3 + 0.001 * X), grey(0 * X + 0.4), "in steps of 1/255"
WHOLE = "frame.color is in whole numbers"


@pytest.mark.parametrize(
    ("color", "said", "found"),
    [
        (spread(-0.01, 0.01, EVEN), "negative in 1% of its values", False),
        (spread(-0.01, 0.012, EVEN), "negative in 1% of its values", True),
        (spread(-1e-7, 0.5, EVEN), "negative", False),  # rounded
        (grey(BYTES), f"{WHOLE} up to 255", True), (grey(BYTES), "Divide by 255", True),
        (srgb_decoded(grey(BYTES)), f"{WHOLE} up to 255", True),
        (whole_numbers(15), f"{WHOLE} up to 15", True),
        (spread(0.5, 0.008, grey(BYTES)), f"{WHOLE} up to 255", True),
        (whole_numbers(14), WHOLE, False),  # a test pattern
        (whole_numbers(256), WHOLE, False),  # brighter than bytes
        (grey(BYTES) + np.float32(0.1), WHOLE, False), (spread(0.5, 0.01, grey(BYTES)), WHOLE, False),
        (grey(BYTES) / 256, WHOLE, False), (grey(BYTES) / 256, STEPS, False),
        (grey(BYTES) / 255, STEPS, True), ((grey(BYTES) / 255).astype(np.float16), STEPS, True),
    ],
)  # fmt: skip
def test_negative_colours_and_bytes_are_named_and_colours_just_short_of_them_are_not(
    color: Float32, said: str, found: bool
) -> None:
    assert (said in complaints(plain_frame(color=color))) is found


@pytest.mark.parametrize("full", [1, 2])
def test_colour_with_one_or_two_channels_at_1_in_places_is_taken_for_clipped(full: int) -> None:
    def said(share: float, high: float = 1.0) -> str:
        color = PLAIN.reshape(PIXELS, 3).copy()
        color[: round(share * PIXELS), :full], color[-1] = 1.0, high
        return complaints(plain_frame(color=color.reshape(HEIGHT, WIDTH, 3)))

    assert "frame.color is never above 1, and often 1" in said(0.006)
    assert said(0.005) == said(0.006, high=1.1) == "", "a brighter pixel"
    assert complaints(plain_frame(color=spread(1.0, 0.1, PLAIN))) == "", "white paper"


def displayed(
    low: float = 0.05, high: float = 0.999, power: float = 1.0, sky: int = 0, depth: Float32 | None = None
) -> str:
    """Return what is said about a gradient of colour over a slope, of which the first pixels are sky."""
    slope = plain_frame().depth.copy() if depth is None else depth
    slope.reshape(-1)[:sky] = 0.0
    tinted = grey(low + (high - low) * (X / (WIDTH - 1)) ** power) * np.array([1.0, 0.7, 0.5], np.float32)
    return complaints(plain_frame(color=tinted, depth=slope))


def shown_as(top: int) -> str:
    return f"frame.color is never above {top}, and as bright as a displayed image"


@pytest.mark.parametrize("top", [1, 255])
@pytest.mark.parametrize(("low", "high", "power", "found"), [
    (0.05, 0.999, 1.0, True), (0.05, 0.92, 1.0, True),
    (0.05, 0.88, 1.0, False), (0.05, 1.05, 1.0, False),  # it does not fill, or exceeds, the range
    (0.05, 0.999, 1.5, True), (0.05, 0.999, 2.1, False),  # medians of 0.39 and 0.27: the darkness of a scene
    (0.05, 0.999, 0.3, True), (0.05, 0.999, 0.2, False),  # of 0.82 and 0.88
    (0.7, 0.95, 1.0, True), (0.735, 0.95, 1.0, False),  # an even image
])  # fmt: skip
def test_colour_that_fills_the_range_of_a_display_at_its_brightness_is_hinted_at(
    top: int, low: float, high: float, power: float, found: bool
) -> None:
    said = displayed(low * top, high * top, power)
    assert (shown_as(top) in said) is bool(said) is found
    assert ("Divide by 255" in said) is (found and top == 255)


def test_colour_is_judged_by_a_thousand_pixels_of_surfaces() -> None:
    assert shown_as(1) in displayed(sky=PIXELS - 1000)
    assert displayed(sky=PIXELS - 999) == ""


def test_colour_of_a_test_pattern_or_of_noise_is_not_judged() -> None:
    for count, judged in ((99, False), (100, True)):
        depth = (0.1 + 0.001 * quantised(count)).astype(np.float32)
        assert (shown_as(1) in displayed(depth=depth)) is judged
    noise = np.random.default_rng(0).random((HEIGHT, WIDTH))
    for part, judged in ((0.25, True), (0.5, False), (1.0, False)):
        color = grey(0.999 * (part * noise + (1.0 - part) * X / (WIDTH - 1)))
        assert (shown_as(1) in complaints(plain_frame(color=color))) is judged


def test_hints_never_raise_and_mistakes_do() -> None:
    bytes_in_floats = plain_frame(color=grey(BYTES) / 255)
    coarse = plain_frame(depth=(0.1 + 0.01 * quantised(32)).astype(np.float32))
    shown = plain_frame(color=grey(0.05 + 0.94 * X / (WIDTH - 1)))
    for hinted in (bytes_in_floats, coarse, shown):
        with pytest.warns(FrameWarning):
            FrameChecker("strict").check(hinted, (2 * WIDTH, 2 * HEIGHT))
    assert "frame.color is in whole numbers" in complaints(plain_frame(color=grey(BYTES)), validate="strict")


# --- colour at depth edges ---


def edge(
    first: float = 0.0, second: float = 1.0, count: int = 100, *, tones: tuple[float, float] = (0.5, 0.8),
    depths: tuple[float, ...] = (0.5, 0.5, 0.5, 0.1, 0.1, 0.1),
) -> tuple[Float32, Float32]:  # fmt: skip
    """Return tone and depth around one vertical edge that counts `count` times.

    The two pixels at the edge are at `first` and `second` of the contrast of tones.
    """
    profile = np.array([0.0, 0.0, first, second, 1.0, 1.0])
    tone = np.concatenate([np.zeros(3), profile]) * (tones[1] - tones[0]) + tones[0]
    rows = np.ones((count + 2, 1))
    return (rows * tone).astype(np.float32), (rows * [*[depths[0]] * 3, *depths]).astype(np.float32)


TURNS: list[Callable[[Float32], Float32]] = [
    lambda image: image, lambda image: image.T, lambda image: image[:, ::-1], lambda image: image[::-1].T,
]  # fmt: skip


def share_mixed(tone: Float32, depth: Float32) -> float:
    """Return the mixed fraction of an image of these tones in any orientation and brightness."""
    found = {
        round(ieee_arithmetic(mixed)(turn(brightness * tone / (1 - tone)), turn(depth)), 6)
        for turn in TURNS for brightness in (np.float32(1e-3), np.float32(1.0), np.float32(1e3))
    }  # fmt: skip
    assert len(found) == 1
    return found.pop()


@pytest.mark.parametrize("part", [0.15, 0.4, 0.65])
@pytest.mark.parametrize("mixed", [30, 45])
def test_the_fraction_of_edges_with_a_mixed_pixel_on_either_side_is_measured(part: float, mixed: int) -> None:
    tone, depth = edge()
    tone[1 : 1 + mixed] = edge(first=part)[0][1 : 1 + mixed]
    assert share_mixed(tone, depth) == mixed / 100
    tone[60:80] = edge(second=1.0 - part)[0][60:80]
    assert share_mixed(tone, depth) == (mixed + 20) / 100
    assert share_mixed(*edge(part, count=60)) == 1.0
    assert share_mixed(*edge(part, count=59)) == 0.0, "so few prove nothing"


@pytest.mark.parametrize(
    ("first", "second"),
    [(1.0, 1.0), (0.75, 1.0), (0.0, 0.0), (0.0, 0.25), (0.5, 0.5), (-0.2, 1.0), (0.0, 1.2)],
)
def test_a_pixel_of_the_other_side_or_brighter_is_neither_sharp_nor_mixed(
    first: float, second: float
) -> None:
    tone, depth = edge(first=0.4)
    assert share_mixed(tone, depth) == 1.0
    tone[1:36] = edge(first, second)[0][1:36]
    assert share_mixed(tone, depth) == 1.0
    tone[36:70] = edge()[0][36:70]
    tone[70:] = edge(first, second)[0][70:]
    assert share_mixed(tone, depth) == 0.0


@pytest.mark.parametrize(("far", "bright", "seen"), [
    (0.45, 0.8, True), (0.46, 0.8, False), (0.56, 0.8, True), (0.54, 0.8, False), (0.0, 0.8, True),
    (0.1, 0.66, True), (0.1, 0.34, True), (0.1, 0.64, False), (0.1, 0.36, False), (0.1, 0.5, False),
])  # fmt: skip
def test_an_edge_is_a_jump_of_depth_by_a_tenth_with_contrast(far: float, bright: float, seen: bool) -> None:
    mixed = edge(0.4, tones=(0.5, bright), depths=(0.5, 0.5, 0.5, far, far, far))
    assert (share_mixed(*mixed) > 0) is seen


@pytest.mark.parametrize("place", [1, 2, 4, 5])
@pytest.mark.parametrize(("slope", "seen"), [(1.02, True), (1.05, False)])
@pytest.mark.parametrize("direction", [1, -1])
def test_either_side_of_an_edge_is_one_surface(place: int, slope: float, seen: bool, direction: int) -> None:
    depths = np.array([0.5, 0.5, 0.5, 0.1, 0.1, 0.1])
    depths[place : 3 if place < 3 else 6] *= slope**direction
    assert (share_mixed(*edge(0.4, depths=tuple(depths))) > 0) is seen


@pytest.mark.parametrize("column", [0, 1, 4, 5])
@pytest.mark.parametrize("row", [0, 1, 2])
def test_edges_of_textured_surfaces_are_left_out(row: int, column: int) -> None:
    """In every third row, one pixel on a side differs from that side."""
    for by, seen in ((0.04, True), (-0.04, True), (0.07, False), (-0.07, False)):
        tone, depth = edge(0.4, count=198)
        tone[row::3, 3 + column] += np.float32(by * 0.3)
        share = ieee_arithmetic(mixed)(tone / (1 - tone), depth)
        assert (share > 0) is seen


def test_edges_of_narrow_images_are_seen_and_narrower_ones_have_none() -> None:
    tone, depth = edge(0.4)
    assert share_mixed(tone[:, 3:], depth[:, 3:]) == 1.0
    assert share_mixed(tone[:, 4:], depth[:, 4:]) == 0.0
    rows = np.tile(edge(0.4, count=1), (1, 1, 70))  # 70 mixed edges, and 69 sharp ones from tile to tile
    assert share_mixed(*rows) == pytest.approx(70 / 139, abs=1e-6)
    assert share_mixed(*rows[:, :2]) == 0.0


def test_black_and_infinite_pixels_are_no_edges() -> None:
    tone, depth = edge(0.4)
    assert ieee_arithmetic(mixed)(0 * tone, depth) == 0.0
    assert ieee_arithmetic(mixed)(np.inf * tone, depth) == 0.0
    light = tone / (1 - tone)
    light[1:31, 4] = np.inf
    assert ieee_arithmetic(mixed)(light, depth) == 1.0, "of the 68 others"


@pytest.mark.parametrize(("share", "found"), [(52, False), (58, True)])
def test_colour_that_is_mixed_at_most_depth_edges_is_taken_for_filtered(share: int, found: bool) -> None:
    tone, depth = edge()
    tone[1 : 1 + share] = edge(first=0.4)[0][1 : 1 + share]
    motion = np.zeros((*depth.shape, 2), np.float32)
    said = complaints(plain_frame(color=grey(tone / (1 - tone)), depth=depth, motion=motion))
    assert (f"frame.color is mixed at {share}% of the depth edges" in said) is found


# --- colour upside down relative to depth ---


def bands(edges: list[int], wave: int = 10) -> NDArray[np.intp]:
    """Return (h, w) numbers, 0 or 1, that change below these rows, in steps of up to `wave` rows."""
    lower = np.arange(WIDTH) * 10 // WIDTH % wave
    passed = np.arange(HEIGHT)[:, None, None] > np.array(edges) + lower[:, None]
    return np.asarray(passed.sum(axis=2) % 2)


def banded(image: NDArray[np.intp], depth: NDArray[np.intp], jump: float = 0.2, texture: float = 0.01) -> str:
    """Return what is said about bands of colour and of depth."""
    color = grey(0.2 + 0.5 * image + texture * (np.arange(HEIGHT)[:, None] % 2))
    return complaints(plain_frame(color=color, depth=(0.25 + 0.25 * jump * depth).astype(np.float32)))


ROWS = [1, 14, 31, 46]
BANDS = bands(ROWS)
FLIPPED = BANDS[::-1]
TURNED = "frame.color is upside down relative to depth"


def test_colour_whose_edges_fit_depth_only_if_flipped_is_upside_down() -> None:
    assert TURNED in banded(FLIPPED, BANDS)
    assert banded(BANDS, BANDS) == ""
    assert banded(FLIPPED ^ BANDS, BANDS) == "", "edges fit either way"
    assert banded(BANDS[:, ::-1], BANDS) == "", "edges fit neither way"


def test_where_colour_is_upside_down_is_judged_by_20_rows_with_edges_of_depth() -> None:
    for edges, judged in ((ROWS[:2], True), (ROWS[:1], False)):
        assert (TURNED in banded(bands(edges)[::-1], bands(edges))) is judged
    assert TURNED not in banded(FLIPPED, BANDS, jump=0.1), "slopes"
    assert TURNED in banded(FLIPPED, BANDS, jump=0.13)


def test_a_straight_horizon_is_one_coincidence_however_wide() -> None:
    for count, judged in ((3, False), (19, False), (20, True)):
        straight = bands([3 * row for row in range(count)], wave=1)
        assert (TURNED in banded(straight[::-1], straight)) is judged


def test_colour_is_upside_down_only_if_edges_stand_out_clearly() -> None:
    """Between the rows of an image with strong texture, edges change little more than the rest."""
    rows = Y.astype(np.intp)
    assert TURNED in banded(FLIPPED, BANDS, texture=0.2)
    assert TURNED not in banded(FLIPPED, BANDS, texture=0.5)
    assert TURNED not in banded(rows % 2 ^ BANDS, BANDS), "edges stand out no more than the rest"
    assert TURNED not in banded(FLIPPED ^ bands(ROWS[:3]), BANDS), "upright it fits nearly as well"
    floor = rows % 2 * (rows >= HEIGHT // 2)
    assert TURNED not in banded(floor, bands(ROWS[:2])), "flipped, edges of the upper half are on the floor"


def test_how_clearly_colour_is_upside_down_is_said_and_bad_pixels_are_left_out() -> None:
    assert "edges agree 4.0x better" in banded(FLIPPED ^ bands(ROWS[:1]), BANDS, texture=0.0)
    light, depth = 0.2 + 0.5 * FLIPPED, (1.0 + 0.2 * BANDS).astype(np.float32) / 4
    assert complaints(plain_frame(color=grey(0 * light), depth=depth)) == ""
    for bad in (np.inf, 6e4):  # the second is a firefly
        light[3, 7] = bad
        assert TURNED in complaints(plain_frame(color=grey(light), depth=depth))


# --- depth ---


@pytest.mark.parametrize(("share", "found"), [(0.01, False), (0.03, True)])
def test_a_sky_of_1_is_that_of_forward_depth_and_one_below_0_of_none(share: float, found: bool) -> None:
    depth = spread(1.0, share, plain_frame().depth)
    assert ("it looks forward" in complaints(plain_frame(depth=depth))) is found
    depth[-1] = 0.0  # a sky of reversed depth, too
    assert complaints(plain_frame(depth=depth)) == ""
    assert complaints(plain_frame(depth=spread(1.0, share, 5 * plain_frame().depth))) == "", "not the largest"
    depth[3, 4] = -0.01
    assert "negative, as small as -0.01" in complaints(plain_frame(depth=depth))


def kind_of(depth: NDArray[Any]) -> str:
    """Return which kind the depth is said to have; "" if nothing is said."""
    said = complaints(plain_frame(depth=depth.astype(np.float32)))
    return said.partition("it looks ")[2].partition(";")[0]


DISTANCE = 3.0 / (1.0 - 0.95 * (0.7 * X / WIDTH + 0.3 * Y / HEIGHT))
"""A plane, from 3 to 50."""


@pytest.mark.parametrize(
    ("depth", "kind"),
    [
        (1.0 - 0.25 / DISTANCE, "forward"),
        (spread(1.0, 0.01, (1.0 - 0.25 / DISTANCE).astype(np.float32)), "forward"),
        (1.0 - 0.35 / DISTANCE, ""),
        (0.955 + 0.03 * X / WIDTH, ""),
        (0.91 + 0.08 * X / WIDTH, ""),
        (0.92 + 0.2 * DISTANCE, ""),
    ],
    ids=["forward", "little sky", "near", "a wall", "a slope", "distances"],
)
def test_depths_crowded_just_below_1_are_forward_and_even_ones_a_wall(depth: NDArray[Any], kind: str) -> None:
    assert kind_of(depth) == kind


@pytest.mark.parametrize(
    ("depth", "kind"),
    [
        (DISTANCE, "linear"),
        (0.3 * DISTANCE, "linear"),
        (spread(1e6, 0.01, (0.01 * DISTANCE).astype(np.float32)), "linear"),
        (spread(9e5, 0.01, (0.01 * DISTANCE).astype(np.float32)), ""),
        (spread(0.0, 0.1, DISTANCE.astype(np.float32)), ""),
        (1e-3 * DISTANCE, ""),
        (200.0 / DISTANCE, ""),
        (1.0 / (1.0 / DISTANCE + 0.02 * np.sin(X / 3) * np.sin(Y / 3)), ""),
        (1.0 / (0.3 + 1e-4 * X), ""),
        (2.0 / (1.0 - 0.0118 * X + 2e-5 * (X - 40) ** 2), "linear"),
        (2.0 / (1.0 - 0.0118 * X + 4e-5 * (X - 40) ** 2), ""),
        (0 * X + 1.0, ""),
        (0 * X + 5.0, ""),
    ],
    ids=[
        "planes", "within 2", "sky", "no sky", "a sky of 0", "within 1", "near / distance in another unit",
        "no planes", "hardly a slope", "hardly curved", "curved", "one depth of 1", "one depth",
    ],
)  # fmt: skip
def test_depth_is_linear_beyond_1_if_planes_or_a_huge_sky_say_so(depth: NDArray[Any], kind: str) -> None:
    assert kind_of(depth) == kind


# --- few, evenly spaced values ---


def quantised(count: int) -> NDArray[np.intp]:
    """Return `count` whole numbers from 0, that rise by single steps along rows."""
    return INDEX * count // PIXELS if count > WIDTH else X.astype(np.intp) * count // WIDTH


def coarse(depth: NDArray[Any]) -> str:
    """Return the number of values that are said to be few; "" if nothing is said."""
    said = complaints(plain_frame(depth=depth.astype(np.float32)))
    return said.partition("frame.depth is in ")[2].partition(" evenly")[0]


CHANCE = np.sort(np.random.default_rng(3).random(32))


@pytest.mark.parametrize(
    ("depth", "count"),
    [
        (0.1 + 0.01 * quantised(32), "32"),
        (1.0 / (2.0 + 0.1 * quantised(32)), "32"),
        (np.where(Y < 20, 0.0, 0.1 + 0.01 * quantised(32)), "32"),
        (0.1 + 0.002 * quantised(300), "300"),
        (0.1 + 0.002 * quantised(301), ""),
        (0.1 + 0.1 * quantised(6), "6"),
        (0.1 + 0.1 * quantised(5), ""),
        (0.1 + 0.01 * (quantised(16) * 2), "16"),
        (0.1 + 0.5 * CHANCE[quantised(32)], ""),
        (0.1 + 0.5 * np.array([*CHANCE[:16], CHANCE[15] + 2e-7])[quantised(17)], ""),
        (0.1 + 0.01 * np.array([0, 1, 4, 8, 12, 16, 20, 24])[quantised(8)], "8"),
        (0.1 + 0.01 * np.array([0, 1, 4, 8.15, 12, 16, 20, 24])[quantised(8)], ""),
        (0.1 + 0.01 * quantised(80), ""),
        (0.1 + 0.01 * (quantised(32) + 4 * (quantised(32) % 2)), ""),
    ],
    ids=[
        "even", "even inverses", "with sky", "300", "301", "6", "5", "every second", "uneven",
        "nearly the same", "some steps", "between steps", "a plane", "edges",
    ],
)  # fmt: skip
def test_depth_with_few_evenly_spaced_values_is_coarse(depth: NDArray[Any], count: str) -> None:
    assert coarse(depth) == count


@pytest.mark.parametrize(("rows", "found"), [(25, False), (40, True)])
def test_even_values_are_coarse_only_if_they_are_rounded_in_places(rows: int, found: bool) -> None:
    """Rows of one value each, some of which rise by one step at one column."""
    levels = (np.arange(HEIGHT) * 8 // HEIGHT)[:, None] + ((X == 40) & (rows > Y))
    assert (coarse(0.1 + 0.01 * levels) != "") is found


# --- motion ---


@pytest.mark.parametrize(("share", "found"), [(0.05, False), (0.06, True)])
@pytest.mark.parametrize(("axis", "length"), [(0, 81.0), (1, -61.0)])
def test_motion_across_the_whole_image_is_too_long(
    axis: int, length: float, share: float, found: bool
) -> None:
    motion = plain_frame().motion.copy()
    motion[..., axis] = spread(length, share, motion[..., axis])
    said = complaints(plain_frame(motion=motion))
    assert ("longer than the whole image in 6% of the pixels" in said) is found
    motion[..., axis] = np.clip(motion[..., axis], -59.0, 79.0)
    assert "longer" not in complaints(plain_frame(motion=motion))


@pytest.mark.parametrize(("x", "y", "step"), [
    (0.5 * quantised(16), 0.0, "0.5"), (0.0, 1.0 - 0.25 * quantised(16), "0.25"),
    (0.19 * quantised(16), 0.0, ""), (8.0 * CHANCE[quantised(16)], 0.0, ""),
])  # fmt: skip
def test_vectors_in_even_steps_of_a_fifth_of_a_pixel_are_coarse(x: Any, y: Any, step: str) -> None:
    motion = np.stack(np.broadcast_arrays(x, y, X)[:2], axis=-1).astype(np.float32)
    said = complaints(plain_frame(motion=motion))
    assert f"frame.motion is in steps of {step} pixels" in said if step else not said


@pytest.mark.parametrize(("side", "found"), [(15, False), (16, True)])
def test_motion_across_a_tiny_image_is_fine(side: int, found: bool) -> None:
    part = {
        name: getattr(plain_frame(), name)[:side, : side + 4].copy() for name in ("color", "depth", "motion")
    }
    part["motion"][..., 0] = 40.0
    assert ("longer than" in complaints(plain_frame(**part))) is found


def parallax(by: float, axis: int = 0) -> Float32:
    """Return motion of the right half that differs from that of the left one."""
    motion = plain_frame().motion.copy()
    motion[:, WIDTH // 2 :, axis] = by
    return motion


@pytest.mark.parametrize("axis", [0, 1])
def test_one_depth_everywhere_is_doubted_where_motion_is_not_that_of_a_card(axis: int) -> None:
    card = np.full_like(plain_frame().depth, 0.3)
    ramp = plain_frame().motion.copy()
    ramp[..., axis] = 3.0 + 0.05 * X - 0.07 * Y
    assert complaints(plain_frame(depth=card, motion=ramp)) == ""
    assert "same everywhere" in complaints(plain_frame(depth=card, motion=parallax(4.0, axis)))
    assert complaints(plain_frame(depth=card, motion=parallax(2.0, axis))) == ""
    assert "same everywhere" in complaints(plain_frame(depth=0.0 * card, motion=parallax(4.0, axis)))
    assert complaints(plain_frame(motion=parallax(4.0, axis))) == "", "a slope"


@pytest.mark.parametrize("angle", [0.1, 0.4, 1.2])
def test_a_frame_of_sky_has_no_constant_depth_however_the_camera_turns(angle: float) -> None:
    projection = np.array([[HEIGHT / WIDTH, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 0.1], [0, 0, -1, 0]])
    turn = np.eye(4)
    turn[:3:2, :3:2] = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    sky = np.zeros((HEIGHT, WIDTH), np.float32)
    motion = camera_motion(sky, projection, projection @ turn, near=0.1)
    assert np.ptp(motion[..., 1]) > 40 * angle, "it is not affine"
    assert "same everywhere" not in complaints(plain_frame(depth=sky, motion=motion))
