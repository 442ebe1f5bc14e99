"""Every example runs from a checkout, and the bare one draws what `Upscaler` draws."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

from supersampler import Shot, ShotWriter, Upscaler, shipped_shot

EXAMPLES = Path(__file__).parents[1] / "examples"
FRAMES = 3


def short_shot(folder: Path) -> Shot:
    source = shipped_shot()
    with ShotWriter(folder, name="short", display_size=(640, 360), frame_rate=30.0) as writer:
        for index in range(FRAMES):
            writer.write(source.read(index).frame)
    return Shot.open(folder)


def test_the_bare_example_takes_the_shipped_shot() -> None:
    content = json.loads((shipped_shot().path / "shot.json").read_text())
    assert content["conventions"] == {}  # it converts nothing, and refuses what would need it


def test_bare_onnx_runtime_draws_the_pictures_of_upscaler(tmp_path: Path) -> None:
    shot = short_shot(tmp_path / "shot")
    upscaler = Upscaler("taau", display_size=(640, 360), validate="off")
    script = EXAMPLES / "bare_onnxruntime.py"
    assert "import supersampler" not in script.read_text().replace("not import supersampler", "")
    out = tmp_path / "out"
    command = [sys.executable, str(script), str(upscaler.model.info.folder), str(shot.path), str(out)]
    subprocess.run(command, check=True, timeout=120)
    for item in shot:
        image = np.load(out / f"{item.index:04d}.npy")
        np.testing.assert_array_equal(image, upscaler.step(item.frame))
