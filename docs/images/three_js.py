"""Compare the node for three.js with three.js' own: errors in one scene with a reference, in Chromium.

    PYTHONPATH=tests python docs/images/three_js.py NODE_MODULES      # also: make three

Writes bench/results/three.json, for `supersampler bench tables`, and docs/images/three.jpg. Chromium runs
on its software adapter, which computes the same images on every machine; a quarter of an hour.
"""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from supersampler.errors import SupersamplerError
from supersampler.frame import Float32
from supersampler.integrations.web import serving, site_files
from supersampler.io.display import display_transform, to_uint8
from supersampler.io.files import replacing
from supersampler.io.images import encode_jpeg
from supersampler_bench.quality.metrics import crop, psnr, tpsnr
from supersampler_bench.quality.scores import BORDER, WARM_UP_FRAMES
from supersampler_bench.quality.three_js import NATIVE, TITLES, ThreeRecord, ThreeScores
from supersampler_bench.record import write_json
from supersampler_export.shaders.folder import shader_files
from web_page import chromium, pixels

if TYPE_CHECKING:
    from playwright.sync_api import Browser

ROOT = Path(__file__).parents[2]
METHODS = (*TITLES, "taau", "classifier")
DISPLAY = (320, 180)
FRAMES, SAMPLES = 20, 32
SCORED = range(WARM_UP_FRAMES, FRAMES)
CROPS = ((124, 8), (36, 52), (192, 60))
"""Upper left corners of the crops in the figure, display pixels."""
SIZE, ZOOM, GAP = (100, 56), 3, 8
FIGURE = ("bilinear", "three-taau", NATIVE, "classifier")
"""Methods in the figure, from left to right; the reference follows."""


def images_of(browser: "Browser", url: str, method: str) -> dict[int, Float32]:
    """Return the images of a method as a display shows them; of "reference", the scene with many samples.

    They are by frame; of the first frame, and those that are scored with the one before.
    """
    page = browser.new_page()
    page.set_default_timeout(600_000)
    size = "x".join(map(str, DISPLAY))
    shown = "bilinear" if method == "reference" else method
    page.goto(f"{url}three.html?test&size={size}&method={shown}")
    page.wait_for_function("window.threeDemo || !document.getElementById('note').hidden")
    if page.is_visible("#note"):
        raise SupersamplerError(page.inner_text("#note"))
    page.evaluate("threeDemo.ready()")
    images = {}
    for index in range(FRAMES):
        image = page.evaluate("threeDemo.step()")
        if 0 < index < SCORED.start - 1:
            continue
        if method == "reference":
            image = page.evaluate(f"threeDemo.reference({SAMPLES})")
        images[index] = display_transform(pixels(image, DISPLAY))
    page.close()
    return images


def scores_of(method: str, images: dict[int, Float32], truth: dict[int, Float32]) -> ThreeScores:
    """Return the errors of a method."""
    ours, real = ({i: crop(one, BORDER) for i, one in each.items()} for each in (images, truth))
    return ThreeScores(
        method,
        psnr=float(np.mean([psnr(ours[i], real[i]) for i in SCORED])),
        tpsnr=float(np.mean([tpsnr(ours[i], ours[i - 1], real[i], real[i - 1]) for i in SCORED])),
        first=psnr(ours[0], real[0]),
    )


def figure(images: list[Float32]) -> bytes:
    """Return a JPEG of crops of images, side by side."""
    rows = []
    for left, top in CROPS:
        parts = [to_uint8(image[top : top + SIZE[1], left : left + SIZE[0]]) for image in images]
        parts = [part.repeat(ZOOM, axis=0).repeat(ZOOM, axis=1) for part in parts]
        border = ((0, GAP), (0, GAP), (0, 0))
        rows.append(np.concatenate([np.pad(part, border, constant_values=255) for part in parts], axis=1))
    return encode_jpeg(np.concatenate(rows), quality=88)


def main() -> None:
    """Measure, and write record, table and figure."""
    node_modules = Path(sys.argv[1])
    three = json.loads((node_modules / "three/package.json").read_text("utf-8"))["version"]
    found = {}
    with serving(site_files(shader_files, node_modules=node_modules)) as url, chromium() as browser:
        for name in ("reference", *METHODS):
            found[name] = images_of(browser, url, name)
        version = browser.version
    truth = found["reference"]
    scores = [scores_of(name, found[name], truth) for name in METHODS]
    render = (DISPLAY[0] // 2, DISPLAY[1] // 2)
    record = ThreeRecord(three, version.partition(".")[0], render, DISPLAY, FRAMES, SAMPLES, scores)
    write_json(record, ROOT / "bench/results/three.json")
    with replacing(ROOT / "docs/images/three.jpg") as partial:
        partial.write_bytes(figure([found[name][FRAMES - 1] for name in (*FIGURE, "reference")]))


if __name__ == "__main__":
    main()
