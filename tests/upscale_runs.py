"""Runs of `supersampler upscale` on tiny shots that move, for its tests."""

import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from supersampler import Frame
from supersampler.cli import app
from supersampler.cli.results import Results
from supersampler.io.images import read_exr, write_exr
from supersampler.io.shot import ShotWriter

SIZE, DISPLAY_SIZE = (32, 18), (64, 36)
VELOCITY = (1.3, -0.7)  # pixels a frame


def moving(index: int, *, light: float = 1.0, **overrides: Any) -> Frame:
    """Return a frame of a smooth texture that moves by VELOCITY; light grows by this factor each frame."""
    width, height = SIZE
    jitter = (0.25 * (index % 4) - 0.375, 0.25 * (index // 4 % 4) - 0.375)
    y, x = np.mgrid[:height, :width] + 0.5
    x, y = x + jitter[0] - VELOCITY[0] * index, y + jitter[1] - VELOCITY[1] * index
    waves = np.stack([np.sin(0.5 * x + 0.2 * y), np.cos(0.3 * x - 0.4 * y), np.sin(0.1 * x + 0.6 * y)], -1)
    fields: dict[str, Any] = {
        "color": (np.exp(waves) * light**index).astype(np.float32),
        "depth": np.full((height, width), 0.5, np.float32),
        "motion": np.broadcast_to(np.array([-v for v in VELOCITY], np.float32), (height, width, 2)).copy(),
        "jitter": jitter,
        "reset": index == 0,
    }
    return Frame(**{**fields, **overrides})


def write_shot(
    folder: Path,
    count: int = 8,
    *,
    cuts: tuple[int, ...] = (),
    references: tuple[int, ...] = (),
    frame_rate: float = 30.0,
    **options: Any,
) -> Path:
    """Write a shot of `moving` frames; those of `references` have a white one."""
    white = np.ones((*DISPLAY_SIZE[::-1], 3), np.float32)
    with ShotWriter(folder, name=folder.name, display_size=DISPLAY_SIZE, frame_rate=frame_rate) as writer:
        for index in range(count):
            frame = moving(index, reset=index in (0, *cuts), **options)
            writer.write(frame, reference=white if index in references else None)
    return folder


def interrupt_at(position: int, patch: pytest.MonkeyPatch) -> None:
    """Interrupt a run before a frame is written, once earlier images are: a queued one would be dropped."""
    list_files: Callable[..., None] = Results.list_files

    def stop(self: Results, at: int) -> None:
        if at == position:
            until = time.monotonic() + 60.0
            while self.options.patterns and self.count_complete(at) < at and time.monotonic() < until:
                time.sleep(0.005)
            raise KeyboardInterrupt
        list_files(self, at)

    patch.setattr(Results, "list_files", stop)


def write_renders(folder: Path, names: dict[int, str], **header: Any) -> Path:
    """Write EXR frames as a renderer does; `names` by frame number. To be opened with OURS."""
    for number, name in names.items():
        frame = moving(number)
        assert frame.color is not None
        channels = {axis: frame.color[..., at] for at, axis in enumerate("RGB")}
        channels |= {
            "depth.Z": frame.depth,
            "motion.X": frame.motion[..., 0],
            "motion.Y": frame.motion[..., 1],
        }
        write_exr(folder / f"{name}.exr", channels, **header)
    return folder


OURS = ("--conventions", "supersampler")
"""Options that open `write_renders` in this package's conventions."""


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def said(result: Result) -> str:
    """Return what a command has printed, as one line."""
    return re.sub(r"[\s│╭╮╰╯─]+", " ", result.output)


def succeeded(result: Result) -> Result:
    assert result.exit_code == 0, result.output
    return result


def upscale(shot: object, output: Path, *options: object, method: str = "bilinear") -> Result:
    return succeeded(run("upscale", shot, "-o", output, "--method", method, *options))


def refusal(*arguments: object) -> str:
    """Return the error of a command, once it is sure that it is one line, and the exit code 1 or 2."""
    result = run(*arguments)
    assert result.exit_code in (1, 2), result.output
    assert result.stderr.count("\n") == 1, result.output
    assert result.stderr.startswith("error: ")
    return str(result.stderr)


def files(folder: Path) -> dict[str, bytes]:
    """Return the bytes of all files in a folder, by their names in it."""
    found = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}


def images(folder: Path) -> dict[str, bytes]:
    """Return the bytes of all files in a folder but upscale.json."""
    return {name: data for name, data in files(folder).items() if not name.endswith(".json")}


def pixels(path: Path) -> np.ndarray:
    channels = read_exr(path)
    return np.stack([channels[axis] for axis in "RGB"], axis=-1).astype(np.float32)
