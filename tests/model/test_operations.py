"""Operations against slow definitions in numpy: resampling, motion, clipping, exposure, downsampling."""

import math

import numpy as np
import pytest
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from torch import Tensor

from supersampler.frame import Float32
from supersampler.io.display import followed_exposure, usable_exposure
from supersampler.methods.classifier.spec import ToneSpace
from supersampler.methods.spec import large_size
from supersampler_model import ops

SIZES = st.tuples(st.integers(1, 9), st.integers(1, 7))
RATIOS = st.floats(1.0, 4.0)
JITTER = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
DISPLAY_SIZES = [ops.Size(*size) for size in ((32, 18), (33, 17), (1, 1), (2, 1), (15, 40), (50, 3))]
LUMAS = st.one_of(st.floats(0.0, 65504.0, width=32), st.just(float("nan")))
EXPOSURES = st.one_of(st.just(0.0), st.floats(2.0**-60, 2.0**60, width=32))
BEFORE = st.floats(2.0**-18, 2.0**11, width=32)


def random_image(seed: int, size: tuple[int, int], channels: int = 3) -> Tensor:
    array = np.random.default_rng(seed).random((1, channels, size[1], size[0]))
    return torch.from_numpy(array.astype(np.float32))


def at(image: Tensor, x: int, y: int) -> Tensor:
    height, width = image.shape[2:]
    return image[0, :, min(max(y, 0), height - 1), min(max(x, 0), width - 1)]


def cubic(d: float, sharpness: float) -> float:
    a, d = -sharpness, abs(d)
    if d < 1:
        return (a + 2) * d**3 - (a + 3) * d**2 + 1
    return a * (d**3 - 5 * d**2 + 8 * d - 4) if d < 2 else 0.0


@settings(max_examples=40)
@given(size=SIZES, ratio=RATIOS, jitter=JITTER)
def test_a_display_pixel_is_at_the_position_of_the_contract(
    size: tuple[int, int], ratio: float, jitter: tuple[float, float]
) -> None:
    display = ops.Size(round(size[0] * ratio), round(size[1] * ratio))
    grid = ops.grid_of(display, ops.Size(*size), torch.tensor([jitter], dtype=torch.float32))
    image = random_image(1, size)
    result = ops.resample(image, *grid.bands(ops.Size(*size), ops.linear, reach=1))
    for row in {0, display.height // 2, display.height - 1}:
        for column in {0, display.width // 2, display.width - 1}:
            px = (column + 0.5) * size[0] / display.width - 0.5 - jitter[0]
            py = (row + 0.5) * size[1] / display.height - 0.5 - jitter[1]
            x0, y0 = int(np.floor(px)), int(np.floor(py))
            fx, fy = px - x0, py - y0
            top = at(image, x0, y0) * (1 - fx) + at(image, x0 + 1, y0) * fx
            bottom = at(image, x0, y0 + 1) * (1 - fx) + at(image, x0 + 1, y0 + 1) * fx
            expected = top * (1 - fy) + bottom * fy
            torch.testing.assert_close(result[0, :, row, column], expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(("size", "outputs"), [(40, 100), (100, 100), (70, 31), (1, 3)])
def test_resampling_by_blocks_is_the_sum_over_the_taps_of_each_output(size: int, outputs: int) -> None:
    image = random_image(4, (size, 2))
    position = ops.positions(torch.arange(outputs), outputs, size, torch.tensor([0.3]))
    kernel = ops.gaussian(0.6)
    across = ops.bands(position, size, ops.span(size, outputs), kernel)
    down = ops.bands(torch.arange(2.0), 2, ops.span(2, 2), ops.linear, reach=1)
    result = ops.resample(image, across, down)
    first = position.floor() - 1.0
    expected = torch.zeros_like(result)
    for k in range(4):
        sample = first + k
        expected += image.index_select(3, sample.long().clamp(0, size - 1)) * kernel(sample - position)
    torch.testing.assert_close(result, expected, rtol=1e-5, atol=1e-5)


@settings(max_examples=30)
@given(size=SIZES, sharpness=st.sampled_from([0.5, 0.7]), seed=st.integers(0, 99))
def test_five_bilinear_reads_are_a_cross_of_twelve_cubic_taps(
    size: tuple[int, int], sharpness: float, seed: int
) -> None:
    image = random_image(seed, size)
    random = np.random.default_rng(seed)
    px, py = random.uniform(-0.4, size[0] - 0.6), random.uniform(-0.4, size[1] - 0.6)
    place = torch.tensor([px, py]).reshape(1, 1, 1, 2).float()
    x0, y0 = int(np.floor(px)), int(np.floor(py))
    cross = [(i, j) for i in range(-1, 3) for j in range(-1, 3) if i in (0, 1) or j in (0, 1)]
    weights = [cubic(px - x0 - i, sharpness) * cubic(py - y0 - j, sharpness) for i, j in cross]
    weighted = [at(image, x0 + i, y0 + j) * w for (i, j), w in zip(cross, weights, strict=True)]
    expected = torch.stack(weighted).sum(0) / sum(weights)
    torch.testing.assert_close(
        ops.read_cubic(image, place, sharpness)[0, :, 0, 0], expected, rtol=1e-3, atol=1e-4
    )


@pytest.mark.parametrize("width", [1, 2, 961, 3840, 8191])
def test_reads_near_the_border_and_beyond_take_its_pixels_and_lose_no_light(width: int) -> None:
    light, ramp = torch.ones(1, 1, 2, width), torch.linspace(0.0, 1.0, width).expand(1, 1, 2, -1)
    for off in (0.0, -0.5, 0.4999, -3.0, 1e6):
        x = torch.arange(float(width)) + off
        place = torch.stack([x.expand(2, -1), torch.tensor([[0.0], [1.0]]).expand(-1, width)], dim=2)[None]
        for found in (ops.read(light, place), ops.read_cubic(light, place)):
            assert (found - 1.0).abs().max() < 1e-6
        expected = x.clamp(0.0, width - 1.0) / max(width - 1, 1)
        torch.testing.assert_close(ops.read(ramp, place)[0, 0, 0], expected, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("width", [2, 93, 641, 1920, 3840])
def test_a_read_beyond_the_border_takes_next_to_nothing_of_the_pixel_beside(width: int) -> None:
    light = torch.ones(1, 1, 1, width)
    light[..., 1:-1] = 1e6
    x = torch.tensor([-3.0, width + 2.0])
    place = torch.stack([x, torch.zeros(2)], dim=1)[None, None]
    first, last = ops.read(light, place)[0, 0, 0]
    assert last == 1.0
    assert first - 1.0 <= 1e6 * width * 2.0**-24


@settings(max_examples=30)
@given(size=SIZES, ratio=RATIOS, jitter=JITTER)
def test_a_neighbourhood_is_the_3x3_samples_around_the_nearest_with_edges_repeated(
    size: tuple[int, int], ratio: float, jitter: tuple[float, float]
) -> None:
    display = ops.Size(round(size[0] * ratio), round(size[1] * ratio))
    grid = ops.grid_of(display, ops.Size(*size), torch.tensor([jitter], dtype=torch.float32))
    samples = random_image(5, size, 4)
    window = ops.neighbourhood_samples(samples, grid, 0.5)
    for y, x in {(0, 0), (display.height // 2, display.width // 3), (display.height - 1, display.width - 1)}:
        row, column = int(grid.y.nearest[y]), int(grid.x.nearest[x])
        for i, (dy, dx) in enumerate((dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1)):
            sample = at(samples, column + dx, row + dy)
            torch.testing.assert_close(window.color[0, :, i, y, x], sample[:3])
            away = (column + dx - grid.x.position[x]) ** 2 + (row + dy - grid.y.position[y]) ** 2
            expected = sample[3] * ((-2.0 * away).exp() + 1e-4)
            torch.testing.assert_close(window.weight[0, i, y, x], expected, rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("display", [ops.Size(8, 6), ops.Size(16, 12)])
def test_the_history_is_at_the_pixel_plus_its_motion(display: ops.Size) -> None:
    image = random_image(3, display)
    ratio = display.width / 8
    motion = torch.tensor([2.0, -1.0]).reshape(1, 2, 1, 1) / ratio  # (2, -1) display pixels
    vectors = ops.to_display(motion.expand(1, 2, *display[::-1]), display, ops.Size(8, 6))
    reprojection = ops.reproject(vectors, display, ops.grid_of(display, ops.Size(8, 6), torch.zeros(1, 2)))
    warped = ops.read(image, reprojection.position)
    torch.testing.assert_close(warped[:, :, 1:, :-2], image[:, :, :-1, 2:], rtol=1e-4, atol=1e-5)
    assert reprojection.on_screen[:, :, 1:, :-2].all()
    assert not reprojection.on_screen[:, :, 0].any()
    assert not reprojection.on_screen[:, :, :, -2:].any()


@given(
    color=st.lists(st.floats(-2, 2), min_size=3, max_size=3),
    sample=st.lists(st.floats(-2, 2), min_size=3, max_size=3),
    low=st.lists(st.floats(-1, 0.4), min_size=3, max_size=3),
    size=st.floats(0.01, 1),
)
@settings(max_examples=100)
def test_clipping_ends_inside_the_box_and_leaves_what_is_inside(
    color: list[float], sample: list[float], low: list[float], size: float
) -> None:
    c, s, lo = (torch.tensor(v).reshape(1, 3, 1, 1) for v in (color, sample, low))
    box = ops.Corners(lo, lo + size)
    inside = bool(((c >= box.low) & (c <= box.high)).all())
    for clipped in (ops.clip_to_center(c, box.box()), ops.clip_to_sample(c, s, box), box.clamp(c)):
        assert bool((clipped >= box.low - 1e-4).all())
        assert bool((clipped <= box.high + 1e-4).all())
        if inside:
            torch.testing.assert_close(clipped, c, rtol=1e-4, atol=1e-5)
    distance = ops.overshoot(c, box.box()).item()
    assert (distance <= 1.0 + 1e-4) == inside or abs(distance - 1) < 1e-3


@given(values=st.lists(st.floats(0, 1000, width=32), min_size=3, max_size=3))
def test_tone_and_ycocg_have_inverses(values: list[float]) -> None:
    color = torch.tensor(values).reshape(1, 3, 1, 1)
    back = ops.inverse_tone(ops.from_ycocg(ops.ycocg(ops.tone(color))))
    torch.testing.assert_close(back, color, rtol=2e-3, atol=1e-4)


def test_values_out_of_range_are_clamped_and_only_nan_is_missing() -> None:
    nan, inf = float("nan"), float("inf")
    bad = torch.tensor([nan, inf, -inf, -1e-3, 65505.0, 3e38, 0.0, 65504.0, 0.5]).reshape(1, 1, 1, 9)
    wanted = [7.0, 65504, 0, 0, 65504, 65504, 0, 65504, 0.5]
    torch.testing.assert_close(ops.sanitize(bad, 7.0).ravel(), torch.tensor(wanted))
    assert ops.valid(bad.expand(1, 3, 1, 9)).ravel().tolist() == [0, 1, 1, 1, 1, 1, 1, 1, 1]
    one = torch.ones(1, 3, 1, 1)
    one[:, 1] = nan
    assert ops.valid(one).item() == 0.0


@pytest.mark.parametrize("space", ops.TONES)
def test_a_tone_curve_keeps_to_one_and_comes_back(space: ToneSpace) -> None:
    color = random_image(3, (9, 7)) ** 8 * 60000.0
    toned = ops.TONES[space].tone(color, 1.0)
    assert toned.min() >= 0.0
    assert toned.max() <= 1.0
    torch.testing.assert_close(ops.TONES[space].inverse(toned), color, rtol=1e-2, atol=1e-4)


def by_torch(image: Float32, display: ops.Size) -> Float32:
    planes = torch.from_numpy(image).permute(2, 0, 1)[None]
    return ops.downsample(planes, display, torch.ones(1))[0].permute(1, 2, 0).numpy()


@pytest.mark.parametrize("display", DISPLAY_SIZES)
def test_one_colour_stays_what_it_is(display: ops.Size) -> None:
    width, height = large_size(display)
    image = np.full((height, width, 3), (0.25, 3.0, 40.0), np.float32)
    np.testing.assert_allclose(by_torch(image, display), image[: display.height, : display.width], rtol=1e-4)


@pytest.mark.parametrize("light", [4.0, 20.0, 1000.0])
def test_a_lamp_of_a_larger_image_gains_no_light(light: float) -> None:
    display = ops.Size(40, 24)
    width, height = large_size(display)
    y, x = np.mgrid[:height, :width]
    lit = np.hypot(x - 24.3, y - 15.6) < 7.0
    image = np.where(lit[..., None], light, (0.4, 0.6, 1.2)).astype(np.float32)
    shown = by_torch(image, display)
    assert shown.max() <= 1.001 * light
    assert shown.mean() < 1.02 * image.mean()


def test_a_slope_stays_at_its_place() -> None:
    """In toned values, in which colours are filtered; a shift by a tenth of a pixel would show."""
    display = ops.Size(32, 20)
    width, height = large_size(display)
    x, y = (np.arange(width) + 0.5) / width, (np.arange(height)[:, None] + 0.5) / height
    toned = torch.from_numpy((0.2 + 0.3 * x + 0.2 * y).astype(np.float32)).expand(1, 3, -1, -1)
    image = ops.inverse_tone(toned)
    found = ops.tone(ops.downsample(image, display, torch.ones(1)))[0, 0].numpy()
    x, y = (np.arange(32) + 0.5) / 32, (np.arange(20)[:, None] + 0.5) / 20
    off = np.abs(found - (0.2 + 0.3 * x + 0.2 * y))[3:-3, 3:-3]
    assert off.max() < 6e-4


def test_detail_of_the_display_keeps_its_contrast_and_finer_detail_goes() -> None:
    display = ops.Size(48, 4)
    width, height = large_size(display)
    x = (np.arange(width) + 0.5) * display.width / width

    def contrast(period: float) -> float:
        """Return what is left of stripes of so many display pixels."""
        toned = (0.5 + 0.2 * np.sin(2 * np.pi * x / period)).astype(np.float32)
        image = ops.inverse_tone(torch.from_numpy(toned).expand(1, 3, height, -1))
        found = ops.tone(ops.downsample(image, display, torch.ones(1)))[0, 0, :, 8:-8]
        return float(found.std() * 2**0.5 / 0.2)

    assert contrast(8.0) > 0.97
    assert contrast(4.0) > 0.95
    assert contrast(1.5) < 0.35


def followed(luma: float, exposure: float, before: float) -> float:
    """Follow the exposure of a frame of one luminance; NaN stands for one without usable pixels."""
    usable = torch.full((1, 1, 2, 2), float(luma >= 0.0))
    color = torch.full((1, 3, 2, 2), luma).nan_to_num(0.0)
    return ops.exposure_for(color, usable, torch.tensor([exposure]), torch.tensor([before])).item()


@pytest.mark.parametrize(("luma", "exposure"), [(0.5, 1e4), (0.5, 1e-3), (65504.0, 0.0), (0.001, 0.0)])
def test_an_outlier_changes_the_exposure_once_a_second_frame_confirms_it(
    luma: float, exposure: float
) -> None:
    first = followed(luma, exposure, 0.3)
    assert first == pytest.approx(-0.3), "the one before holds"
    wanted = exposure or abs(followed(luma, 0.0, 0.0))
    assert followed(luma, exposure, first) == pytest.approx(wanted)
    back = followed(0.5, 0.0, first)
    assert back == pytest.approx(followed(0.5, 0.0, 0.3)), "one frame alone leaves nothing"


def test_only_lit_pixels_are_measured_and_a_black_frame_keeps_the_exposure() -> None:
    color = torch.zeros(1, 3, 8, 8)
    color[..., :2, :3] = 0.36
    exposure = ops.exposure_for(color, torch.ones(1, 1, 8, 8), torch.zeros(1), torch.zeros(1))
    assert exposure.item() == pytest.approx(-0.5)
    for black in (0.0, 1e-4):
        assert followed(black, 0.0, 0.3) == pytest.approx(0.3)


@given(luma=LUMAS, exposure=EXPOSURES, before=BEFORE)
def test_one_frame_moves_the_exposure_by_six_stops_at_most(
    luma: float, exposure: float, before: float
) -> None:
    after = followed(luma, exposure, before)
    limit = 6.0 if 2.0**-24 <= exposure <= 2.0**24 else 0.6  # of what is measured a tenth of the way
    assert abs(math.log2(abs(after) / before)) <= limit + 1e-3


@given(luma=LUMAS, exposure=EXPOSURES, before=BEFORE, sign=st.sampled_from([1.0, -1.0, 0.0]))
def test_runtime_and_models_follow_an_exposure_alike(
    luma: float, exposure: float, before: float, sign: float
) -> None:
    before *= sign
    target = 0.18 / luma if luma > 1e-4 else None
    wanted = usable_exposure(exposure or None) or target
    assume(wanted is None or not before or abs(abs(math.log2(wanted / abs(before))) - 6.0) > 1e-3)
    here = followed_exposure(usable_exposure(exposure or None), target, before)
    assert followed(luma, exposure, before) == pytest.approx(here, rel=1e-4)
