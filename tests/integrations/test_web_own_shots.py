"""Shots of the user's own on the page, and its reader of EXR files."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from supersampler.io.images import write_exr
from web_page import opened

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytest_plugins = ["chromium_fixtures"]  # fixtures


def small_shot(folder: Path, *, without: str = "") -> Path:
    """Write a shot of two frames, 32x18, without the channels of one kind."""
    (folder / "frames").mkdir(parents=True)
    rng = np.random.default_rng(0)
    for index in range(2):
        channels = {
            name: rng.random((18, 32)).astype(np.float16) for name in ("R", "G", "B", "motion.X", "motion.Y")
        }
        channels["depth.Z"] = rng.random((18, 32)).astype(np.float32)
        kept = {
            name: plane for name, plane in channels.items() if not without or not name.startswith(without)
        }
        write_exr(folder / f"frames/{index}.exr", kept)
    frames = [
        {"file": f"frames/{index}.exr", "jitter": [0.1, -0.2], "reset": index == 0} for index in range(2)
    ]
    content = {
        "version": 1,
        "name": "mine",
        "render_size": [32, 18],
        "display_size": [64, 36],
        "frames": frames,
    }
    (folder / "shot.json").write_text(json.dumps(content))
    return folder


def test_a_chosen_shot_is_shown(page: "Page", url: str, tmp_path: Path) -> None:
    opened(page, f"{url}?test&size=320x180&method=taa")
    page.set_input_files("[name=folder]", small_shot(tmp_path / "mine"))
    page.wait_for_function("supersamplerDemo.state.displaySize[0] === 64")
    assert page.locator("[name=source] option[value=own]").inner_text() == "shot mine"
    assert not page.is_visible("#note")


def test_a_chosen_shot_with_a_missing_channel_is_refused_by_its_name(
    page: "Page", url: str, tmp_path: Path
) -> None:
    opened(page, f"{url}?test&size=320x180&method=taa")
    page.set_input_files("[name=folder]", small_shot(tmp_path / "mine", without="motion"))
    page.wait_for_selector("#note:visible")
    assert page.inner_text("#note") == (
        "frames/0.exr has no channel motion.X, motion.Y; it has B, G, R, depth.Z."
    )
    assert page.evaluate("supersamplerDemo.state.displaySize") == [320, 180], "the page goes on as before"


def test_a_dropped_folder_is_read(page: "Page", url: str, tmp_path: Path) -> None:
    opened(page, f"{url}?test&size=320x180&method=taa")
    folder = small_shot(tmp_path / "mine", without="depth")
    session = page.context.new_cdp_session(page)
    for kind in ("dragEnter", "dragOver", "drop"):
        data = {"items": [], "files": [str(folder)], "dragOperationsMask": 1}
        session.send("Input.dispatchDragEvent", {"type": kind, "x": 200, "y": 300, "data": data})
    page.wait_for_selector("#note:visible")
    assert (
        page.inner_text("#note") == "frames/0.exr has no channel depth.Z; it has B, G, R, motion.X, motion.Y."
    )


@pytest.mark.parametrize("compression", ["none", "zips", "zip"])
def test_exr_files_are_read_bit_for_bit(page: "Page", url: str, site: Path, compression: str) -> None:
    rng = np.random.default_rng(1)
    half = rng.normal(0.0, 9.0, (37, 21)).astype(np.float16)
    whole = (rng.random((37, 21)) * 1e20).astype(np.float32)
    write_exr(site / "read.exr", {"A.half": half, "B.float": whole}, compression=compression)
    page.goto(f"{url}blank.html")
    found = page.evaluate(
        """async () => {
            const { readExr } = await import("./page/exr.js");
            const file = await (await fetch("read.exr")).arrayBuffer();
            const { width, height, planes } = await readExr(file, "read.exr");
            const [half, whole] = ["A.half", "B.float"].map((name) => Array.from(planes.get(name).values));
            return [width, height, half, whole];
        }"""
    )
    assert found[:2] == [21, 37]
    np.testing.assert_array_equal(np.array(found[2], np.uint16), half.view(np.uint16).ravel())
    np.testing.assert_array_equal(np.array(found[3], np.float32), whole.ravel())


def test_exr_files_that_cannot_be_read_say_why(page: "Page", url: str, site: Path) -> None:
    image = np.random.default_rng(2).random((40, 40, 3)).astype(np.float16)
    write_exr(site / "piz.exr", image, compression="piz")
    write_exr(site / "cut.exr", image)
    (site / "cut.exr").write_bytes((site / "cut.exr").read_bytes()[:-500])
    (site / "text.exr").write_bytes(b"no image at all")
    page.goto(f"{url}blank.html")
    found = page.evaluate(
        """() => Promise.all(["piz.exr", "cut.exr", "text.exr"].map(async (name) => {
            const { readExr } = await import("./page/exr.js");
            const file = await (await fetch(name)).arrayBuffer();
            return readExr(file, name).then(() => "read", (error) => error.message);
        }))"""
    )
    assert found[0].startswith("piz.exr: has compression PIZ; this page reads ZIP, ZIPS and none.")
    assert found[1].startswith("cut.exr: is damaged or cut off (")
    assert found[2] == "text.exr: is no OpenEXR file."
