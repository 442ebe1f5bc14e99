"""Tests of compare.html: self-contained, written atomically, with the right layers and numbers."""

import base64
import json
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from OpenImageIO import ImageBuf

from supersampler import ArgumentError, Frame
from supersampler.io.compare import ERROR_SCALE, PSNR, About, compare_layers, compare_page, false_color
from supersampler.io.display_transforms import display_transform_from

ABOUT = About(title="a <b>shot</b> </script>", method="taau", display_size=(8, 6))


def pixels(seed: int, width: int = 8, height: int = 6) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), np.uint8)


def summary(html: str) -> dict[str, object]:
    [text] = re.findall(r'<script type="application/json" id="page">(.*?)</script>', html)
    content: dict[str, object] = json.loads(text)
    return content


def images(html: str) -> dict[str, tuple[str, bytes]]:
    found = re.findall(r'<script type="text/plain" id="(.*?)">data:image/(\w+);base64,(.*?)</script>', html)
    return {name: (kind, base64.b64decode(data)) for name, kind, data in found}


def frame(color: NDArray[np.float32] | None) -> Frame:
    flat = np.zeros((3, 4, 2), np.float32)
    return Frame(color=color, depth=flat[..., 0], motion=flat, jitter=(0.0, 0.0))


@pytest.fixture
def html(tmp_path: Path) -> str:
    with compare_page(tmp_path / "compare.html", ABOUT) as page:
        page.add(3, {"input": pixels(1), "output": pixels(2)})
        page.add(5, {"input": pixels(3), "output": pixels(4), "class map": pixels(5)}, {"dB": 30.0})
    return (tmp_path / "compare.html").read_text(encoding="utf-8")


def test_the_page_asks_for_nothing_from_outside(html: str) -> None:
    assert re.findall(r"https?:|//\w|<link|\bsrc=|@import|\bfetch\(|XMLHttpRequest", html) == []


def test_the_summary_lists_frames_layers_and_numbers(html: str) -> None:
    content = summary(html)
    assert content["layers"] == ["input", "output", "class map"]
    assert content["numbers"] == ["dB"]
    assert content["frames"] == [
        {"number": 3, "layers": ["input", "output"], "numbers": {}},
        {"number": 5, "layers": ["input", "output", "class map"], "numbers": {"dB": 30.0}},
    ]


def test_text_from_a_shot_cannot_become_markup(html: str) -> None:
    assert summary(html)["title"] == ABOUT.title
    assert ABOUT.title not in html


def test_small_images_come_back_to_the_byte(html: str, tmp_path: Path) -> None:
    kind, data = images(html)["5/class map"]
    (tmp_path / "back.png").write_bytes(data)
    assert kind == "png"
    np.testing.assert_array_equal(ImageBuf(str(tmp_path / "back.png")).get_pixels("uint8"), pixels(5))


def test_a_page_without_frames_is_not_written(tmp_path: Path) -> None:
    want = "frames is none; want at least one"
    with pytest.raises(ArgumentError, match=want), compare_page(tmp_path / "compare.html", ABOUT):
        pass
    assert list(tmp_path.iterdir()) == []


def test_frames_out_of_order_are_refused(tmp_path: Path) -> None:
    with compare_page(tmp_path / "compare.html", ABOUT) as page:
        page.add(-2, {"output": pixels(0)})
        with pytest.raises(ArgumentError, match="number is -2; want frames in order, more than -2"):
            page.add(-2, {"output": pixels(0)})


def test_error_and_psnr_are_those_of_the_shown_images() -> None:
    black, white = np.zeros((6, 8, 3), np.float32), np.ones((6, 8, 3), np.float32)
    layers, numbers = compare_layers(frame(black[:3, :4]), black, white, 1.0)
    shown = 0.735357  # sRGB of 1 / (1 + 1)
    assert list(layers) == ["input", "output", "reference", "error"]
    assert numbers[PSNR] == pytest.approx(-20 * np.log10(shown), abs=1e-4)
    np.testing.assert_array_equal(layers["error"], false_color(np.full((6, 8), shown / ERROR_SCALE)))
    layers, numbers = compare_layers(frame(None), black, None, 1.0)
    assert (list(layers), numbers) == (["output"], {})
    white[:, 3:], black[:, :2] = np.nan, 1.0  # two columns are exact, one is not, the others are unknown
    layers, numbers = compare_layers(frame(None), black, white, 1.0)
    assert numbers[PSNR] == pytest.approx(-20 * np.log10(shown) + 10 * np.log10(3), abs=1e-4)
    assert (layers["error"][:, 3:] == false_color(np.zeros((1, 1)))).all()
    assert compare_layers(frame(None), black, np.full_like(white, np.nan), 1.0)[1] == {}


def test_bicubic_stands_between_input_and_output_as_the_transform_shows_it() -> None:
    large, srgb = np.full((6, 8, 3), 0.25, np.float32), display_transform_from(srgb=True)
    layers, _ = compare_layers(frame(large[:3, :4]), large, large, 3.0, bicubic=large * 2, transform=srgb)
    assert list(layers) == ["input", "bicubic", "output", "reference", "error"]
    assert [int(layer[0, 0, 0]) for layer in layers.values()] == [137, 188, 137, 137, 0]


def test_false_colours_grow_lighter_evenly() -> None:
    values = np.linspace(-0.1, 1.1, 49)[None]
    encoded = false_color(values)[0] / 255.0
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    luminance = linear @ np.array([0.2126, 0.7152, 0.0722])
    lightness = np.where(luminance > 0.008856, 116 * np.cbrt(luminance) - 16, 903.3 * luminance)
    assert (np.diff(lightness[4:45]) > 0).all()
    assert np.abs(lightness[4:45] - np.linspace(0, lightness[-1], 41)).max() < 8  # of 100
