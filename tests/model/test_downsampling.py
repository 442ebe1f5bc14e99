"""The filter of `classifier-large` keeps colours and places; the kernel computes what torch computes."""

import numpy as np
import pytest
import torch

from supersampler.backends.cpu.kernel_loader import load_kernels
from supersampler.backends.cpu.layout import LANES
from supersampler.backends.cpu.memory import address
from supersampler.backends.cpu.resample_tables import up_to
from supersampler.backends.cpu.structs import pack
from supersampler.frame import Float32
from supersampler.methods.classifier_large.cpu import DOWNSAMPLE
from supersampler.methods.classifier_large.downsampling import DownsamplingTables
from supersampler.methods.classifier_large.structs import Downsampling
from supersampler.methods.spec import large_size
from supersampler_model import ops

SIZES = [
    ops.Size(32, 18),
    ops.Size(33, 17),
    ops.Size(1, 1),
    ops.Size(2, 1),
    ops.Size(15, 40),
    ops.Size(50, 3),
]


def by_torch(image: Float32, display: ops.Size, exposure: float = 1.0) -> Float32:
    planes = torch.from_numpy(image).permute(2, 0, 1)[None]
    return ops.downsample(planes, display, torch.tensor([exposure]))[0].permute(1, 2, 0).numpy()


def by_kernel(image: Float32, display: ops.Size, exposure: float, parts: int) -> Float32:
    """Filter in some parts of rows, as threads do."""
    t, out = DownsamplingTables(display, 1), np.full((display.height, display.width, 3), np.nan, np.float32)
    t.image[:] = image
    large = image.shape
    work = Downsampling(
        t.image, out, t.rows, t.row_weights, t.columns, t.column_weights,
        display.width, up_to(display.width, LANES), large[1], large[0], exposure,
    )  # fmt: skip
    kernel = load_kernels(DOWNSAMPLE)[DOWNSAMPLE]
    edges = np.linspace(0, display.height, parts + 1).astype(int)
    for y0, y1 in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        if y0 < y1:
            kernel(pack(work), address(t.scratch[0]), y0, y1)
    return out


def larger(display: ops.Size) -> Float32:
    width, height = large_size(display)
    return np.random.default_rng(0).gamma(0.5, 4.0, (height, width, 3)).astype(np.float32)


@pytest.mark.parametrize("display", SIZES)
def test_one_colour_stays_what_it_is(display: ops.Size) -> None:
    width, height = large_size(display)
    image = np.full((height, width, 3), (0.25, 3.0, 40.0), np.float32)
    np.testing.assert_allclose(by_torch(image, display), image[: display.height, : display.width], rtol=1e-4)


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


@pytest.mark.parametrize("exposure", [1.0, 0.03, 50.0])
@pytest.mark.parametrize("display", SIZES)
def test_the_kernel_computes_what_torch_computes(display: ops.Size, exposure: float) -> None:
    image = larger(display)
    image.reshape(-1)[::7] = 0.0
    image.reshape(-1)[3::31] = 65504.0
    ours = by_torch(image, display, exposure)
    for parts in (1, 3):
        theirs = by_kernel(image, display, exposure, parts)
        toned = [
            ops.tone(torch.from_numpy(each * exposure).permute(2, 0, 1)[None]) for each in (ours, theirs)
        ]
        torch.testing.assert_close(*toned, rtol=0.0, atol=2e-5)
        assert theirs.min() >= 0.0
        assert theirs.max() <= 65504.0
