"""Every example runs from a checkout, with the images of `Upscaler`; the docs' snippets on data run too."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from OpenImageIO import ImageBuf

from noise import MASKED_DISPLAY, masked_shot, noise
from supersampler import Shot, Upscaler, halton_jitter
from supersampler.conventions import jitter_phase_count
from supersampler.io.display import display_transform
from supersampler.io.shot import ShotWriter
from supersampler_model.data.dataset.rendering import render_sequence
from supersampler_model.data.dataset.storage import Description, SequenceEntry, create_dataset
from supersampler_model.data.rendered import input_frame
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.sequences import SequenceSpec, make_sequence

EXAMPLES = Path(__file__).parents[1] / "examples"
DOCS = EXAMPLES.parent / "docs"
FRAMES = 3


def short_shot(folder: Path) -> Shot:
    source = Shot.open("plaza")
    with ShotWriter(folder, name="short", display_size=(640, 360), frame_rate=30.0) as writer:
        for index in range(FRAMES):
            writer.write(source.read(index).frame)
    return Shot.open(folder)


def sparse_shot(folder: Path) -> Shot:
    """Write frames of several sizes; shot.json leaves out all that it may."""
    with ShotWriter(folder, name="sparse", display_size=(64, 36), frame_rate=30.0) as writer:
        for index, size in enumerate([(32, 18), (29, 17), (32, 18)]):
            writer.write(noise(index, size))
    content = json.loads((folder / "shot.json").read_text())
    kept = ("file", "jitter", "render_size")
    content["frames"] = [{k: entry[k] for k in kept if k in entry} for entry in content["frames"]]
    (folder / "shot.json").write_text(json.dumps(content))
    return Shot.open(folder)


def test_the_bare_example_takes_the_shipped_shot() -> None:
    content = json.loads((Shot.open("plaza").path / "shot.json").read_text())
    assert content["conventions"] == {}  # it converts nothing, and refuses what would need it


@pytest.mark.parametrize(
    ("method", "write"),
    [("classifier", short_shot), ("classifier-large", masked_shot), ("taau", sparse_shot)],
)
def test_bare_onnx_runtime_computes_the_images_of_upscaler(
    method: str, write: Callable[[Path], Shot], tmp_path: Path
) -> None:
    shot = write(tmp_path / "shot")
    upscaler = Upscaler(method, display_size=shot.display_size, executor="onnx", validate="off")
    script = EXAMPLES / "bare_onnxruntime.py"
    assert "import supersampler" not in script.read_text().replace("not import supersampler", "")
    out = tmp_path / "out"
    command = [sys.executable, str(script), str(upscaler.model.info.folder), str(shot.path), str(out)]
    subprocess.run(command, check=True, timeout=280)
    for item in shot:
        image = np.load(out / f"{item.index:04d}.npy")
        np.testing.assert_array_equal(image, upscaler.step(item.frame))


def test_raw_frames_are_those_of_the_shot(tmp_path: Path) -> None:
    script, shot = EXAMPLES / "raw_frames.py", masked_shot(tmp_path / "shot")
    command = [sys.executable, str(script), str(shot.path), str(tmp_path / "raw"), "--frames", "3"]
    subprocess.run(command, check=True, timeout=280)
    described = json.loads((tmp_path / "raw" / "frames.json").read_text())
    assert described["display"] == list(MASKED_DISPLAY)
    assert [entry["reset"] for entry in described["frames"]] == [True, False, False]
    for index, entry in enumerate(described["frames"]):
        frame = shot.read(index).frame
        values = list(frame.jitter), frame.exposure, frame.pre_exposure
        assert (entry["jitter"], entry["exposure"], entry["pre_exposure"]) == values
        for name, channels in {"color": 4, "depth": 1, "motion": 2, "reactive": 1}.items():
            image = getattr(frame, name)
            assert (name in entry) == (image is not None)
            if image is not None:
                file = tmp_path / "raw" / entry[name]
                pixels = np.fromfile(file, np.float32).reshape(*frame.size[::-1], channels)
                image = np.atleast_3d(image)
                np.testing.assert_array_equal(pixels[..., : image.shape[2]], image)


@pytest.mark.parametrize(
    ("script", "arguments", "message"),
    [
        (
            "cpp_onnxruntime/raw_planes.py",
            ["plaza", "raw", "-3"],
            "Write the frames of a shot as raw float32",
        ),
        ("cpp_onnxruntime/raw_planes.py", ["plaza", "raw", "0"], "Write the frames of a shot"),
        (
            "cpp_onnxruntime/raw_planes.py",
            ["plaza", "raw", "all"],
            "Write the frames of a shot as raw float32",
        ),
        ("cpp_onnxruntime/raw_planes.py", ["plazza", "raw"], "plazza: there is no such file or folder"),
        ("raw_frames.py", ["plazza", "raw"], "plazza: there is no such file or folder"),
        ("bare_onnxruntime.py", ["model", "shot", "raw"], "model/model.json is missing"),
    ],
)
def test_frames_that_cannot_be_read_are_named_in_one_line(
    tmp_path: Path, script: str, arguments: list[str], message: str
) -> None:
    command = [sys.executable, str(EXAMPLES / script), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=280, cwd=tmp_path)
    assert done.returncode == 1
    assert done.stderr.startswith(message)
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "raw").exists()


def test_the_viewer_stops_rendering_once_the_image_has_converged(tmp_path: Path) -> None:
    image = tmp_path / "at_rest.png"
    command = [sys.executable, str(EXAMPLES / "viewer_at_rest.py"), "--model", "taau", "-o", str(image)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=280, check=True)
    found = re.search(r"converged, (\d+) frames after .*\nrendered (\d+) of 208 frames", done.stdout)
    assert found is not None, done.stdout
    standing, rendered = map(int, found.groups())
    assert standing <= 3 * jitter_phase_count(2.0)
    assert rendered == 24 + standing + 24  # it pans, stands still, pans again
    assert read_png(image).shape == (180, 320, 3)


def live(*arguments: str, **environment: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, str(EXAMPLES / "live_renderer.py"), *arguments]
    return subprocess.run(
        command, env={**os.environ, **environment}, capture_output=True, text=True, timeout=280
    )


def read_png(file: Path) -> NDArray[np.float32]:
    return np.asarray(ImageBuf(str(file)).get_pixels("float"))


def test_the_live_renderer_shows_its_input_beside_the_images_of_upscaler(tmp_path: Path) -> None:
    arguments = ["--family", "foliage", "--seed", "3", "--frames", "10", "--display-size", "128x72"]
    done = live(*arguments, "--zoom", "4", "--window", "never", "-o", str(tmp_path))
    assert done.returncode == 0, done.stderr
    assert "rendering" in done.stdout
    assert "upscaling, classifier" in done.stdout

    sequence = make_sequence(SequenceSpec(family="foliage", seed=3, frames=10))
    assert [index for index in range(10) if sequence.cut(index)] == [0, 6]  # one to get wrong
    renderer, upscaler = Renderer((128, 72)), Upscaler("classifier", display_size=(128, 72))
    for index in range(10):
        scene, jitter, exposure = sequence.scene(index), halton_jitter(index, 2.0), sequence.exposure(index)
        assert exposure is not None
        color, surfaces = renderer.frame(scene, (64, 36), jitter=jitter)
        frame = input_frame(
            color, surfaces, None, jitter=jitter, reset=sequence.cut(index), exposure=exposure
        )
        shown = read_png(tmp_path / f"{index:04d}.png")
        assert shown.shape == (144, 256, 3)
        squares = display_transform(color, exposure).repeat(2, axis=0).repeat(2, axis=1)
        output = display_transform(upscaler.step(frame), exposure)
        np.testing.assert_allclose(shown[:72], np.concatenate([squares, output], axis=1), atol=0.004)
        for left in (0, 128):
            middle = shown[27:45, left + 48 : left + 80].repeat(4, axis=0).repeat(4, axis=1)
            np.testing.assert_array_equal(shown[72:, left : left + 128], middle)


def test_the_live_renderer_renders_at_least_a_pixel(tmp_path: Path) -> None:
    done = live("--display-size", "1x1", "--frames", "1", "-o", str(tmp_path))
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("option", ["--frames", "--ratio"])
def test_the_live_renderer_reports_errors_in_one_line(tmp_path: Path, option: str) -> None:
    done = live(option, "0", "-o", str(tmp_path))
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert " is 0" in done.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is always a display")
def test_without_a_display_a_window_that_was_asked_for_is_refused_in_one_line(tmp_path: Path) -> None:
    done = live("--window", "always", "-o", str(tmp_path), DISPLAY=":nowhere")
    assert done.returncode == 1
    assert done.stderr.startswith("no window: ")
    assert done.stderr.endswith("--window never only writes files.\n")
    assert not list(tmp_path.iterdir())


def test_the_snippets_of_the_docs_on_data_run_on_a_training_set(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = SequenceSpec(family="floors", seed=0, frames=2)
    entry = SequenceEntry(spec=spec, ratio=2.0, split="train")
    renderer = Renderer((96, 72), samples=1)
    description = Description(display_size=(96, 72), samples=1, gbuffers=False, seed=0, sequences=(entry,))
    render_sequence(create_dataset(tmp_path / "data", description), entry, renderer)
    monkeypatch.chdir(tmp_path)
    found: dict[str, Any] = {"renderer": renderer}
    for snippet in re.findall("```python\n(.*?)```", (DOCS / "data.md").read_text("utf-8"), re.DOTALL):
        exec(snippet, found)  # noqa: S102
    assert found["crop"].shape == (8, 32, 3)
    assert found["upscaler_input"].size == (48, 36)
