"""Helpers of the tests of the page in Chromium, on its software adapter: `make web` runs them.

SUPERSAMPLER_CHROMIUM is the browser, by default what PATH has; SUPERSAMPLER_NODE_MODULES has npm's packages.
"""

import base64
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from supersampler.frame import Float32
from supersampler.io.display import decibels, display_transform
from supersampler.io.images import read_image

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

NAMES = ("chromium", "chromium-browser", "google-chrome")
CHROMIUM = os.environ.get("SUPERSAMPLER_CHROMIUM") or next(filter(None, map(shutil.which, NAMES)), None)
NODE_MODULES = os.environ.get("SUPERSAMPLER_NODE_MODULES")
SOFTWARE = (
    "--enable-unsafe-webgpu",
    "--use-webgpu-adapter=swiftshader",
    "--use-vulkan=swiftshader",
    "--use-angle=swiftshader",
    "--enable-features=Vulkan,WebGPU",
)
BORDER = 8


class FolderFiles(Mapping[str, Callable[[], bytes]]):
    """The files of a folder, as `serving` takes them; tests may add some later."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __getitem__(self, name: str) -> Callable[[], bytes]:
        if not (self.folder / name).is_file():
            raise KeyError(name)
        return (self.folder / name).read_bytes

    def __iter__(self) -> Iterator[str]:
        return (path.relative_to(self.folder).as_posix() for path in self.folder.rglob("*") if path.is_file())

    def __len__(self) -> int:
        return len(list(iter(self)))


@contextmanager
def chromium() -> "Iterator[Browser]":
    """Run Chromium on its software adapter during the block.

    Raises:
        ImportError: playwright is not installed.
    """
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        arguments = [*SOFTWARE, *(["--no-sandbox"] if os.getuid() == 0 else [])]
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
        yield browser
        browser.close()


def opened(page: "Page", address: str) -> "Page":
    page.goto(address)
    page.wait_for_function("window.supersamplerDemo || !document.getElementById('note').hidden")
    assert not page.is_visible("#note"), page.inner_text("#note")
    return page


def pixels(text: str, size: tuple[int, int]) -> Float32:
    rgba = np.frombuffer(base64.b64decode(text), np.float32).reshape(size[1], size[0], 4)
    return np.ascontiguousarray(rgba[..., :3])


def read(page: "Page", call: str, size: tuple[int, int]) -> Float32:
    return pixels(page.evaluate(f"supersamplerDemo.{call}"), size)


def psnr(image: Float32, truth: Float32) -> float:
    difference = display_transform(image) - display_transform(truth)
    return decibels(float(np.mean(difference[BORDER:-BORDER, BORDER:-BORDER] ** 2)))


def screenshot(page: "Page", folder: Path) -> Float32:
    page.locator("#stage").screenshot(path=folder / "shown.png")
    planes = read_image(folder / "shown.png")
    return np.stack([planes[channel] for channel in "RGB"], axis=-1)
