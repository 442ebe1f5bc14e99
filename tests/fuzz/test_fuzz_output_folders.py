"""Fuzz tests of writers: whatever a record in a folder lists, foreign files stay unchanged."""

import json
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

import upscale_runs
from blender_files import RECORDED, fake_blender, scene_file
from fuzzing import dumped, examples, replaced, run_apart
from supersampler.errors import SupersamplerError
from supersampler_export.shaders.folder import write_shader_folder

MINE = ("thesis.tex", "id_ed25519", "notes/0000.exr", "frames/0001.exr", "model.bin", ".ssh/config")
"""Files of somebody else in the folder that is written to; beside it, too."""


def upscale(folder: Path) -> Iterator[list[str]]:
    yield ["upscale", "plaza", "-o", str(folder), "--frames", "0-1", "--method", "bilinear"]


def blender(folder: Path) -> Iterator[list[str]]:
    words = ["blender", str(scene_file(folder.parent)), "-o", str(folder.parent), "--method"]
    yield [*words, "bilinear", "--frames", "5-6", "--blender", str(fake_blender(folder.parent))]


def commands(folder: Path) -> dict[str, tuple[str, Callable[[], object]]]:
    """The record that each writer reads, and the writer; the folder is what it owns."""

    def run(words: Iterator[list[str]]) -> Callable[[], object]:
        def call() -> None:
            for command in words:
                done = upscale_runs.run(*command, "--overwrite")
                if done.exception is not None and not isinstance(done.exception, SystemExit):
                    raise done.exception

        return call

    return {
        "upscale": ("upscale.0000-0001.json", run(upscale(folder))),
        "blender": ("render.json", run(blender(folder))),
        "shaders": ("upscaler.json", lambda: write_shader_folder("taa", folder)),
    }


def hostile(record: Any, rng: np.random.Generator, outside: Path) -> str:
    """The record with foreign names in its list of files, and a few other changes."""
    names = [*MINE, f"../{MINE[0]}", str(outside), "../*", "*", "####", "../####.exr", "notes/####.exr", "."]
    chosen = [str(names[index]) for index in rng.integers(0, len(names), 6)]
    files = record.get("files") if isinstance(record, dict) else None
    if isinstance(files, dict):
        files |= dict.fromkeys(chosen, next(iter(files.values()), 1))
    elif isinstance(files, list):
        files += chosen
    for _ in range(int(rng.integers(0, 3))):
        record = replaced(record, rng)
    return dumped(record).decode()


def all_files(root: Path, names: tuple[str, ...]) -> dict[Path, bytes]:
    found = {}
    for folder in (root, root / "out" / "render"):
        for name in names:
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(f"{path}".encode())
            found[path] = path.read_bytes()
    return found


def prepare() -> Callable[[int], object]:
    """Run one of the writers over the folder of an earlier run whose record was changed."""

    def run(case: int) -> None:
        rng = np.random.default_rng(case)
        with tempfile.TemporaryDirectory() as made:
            root = Path(made).resolve()
            folder = root / "out" / "render"
            folder.parent.mkdir()
            record, write = list(commands(folder).values())[case % 3]
            write()
            mine = all_files(root, MINE)
            if rng.random() < 0.3:
                (root / "out" / "linked").symlink_to(folder)
            content = json.loads((folder / record).read_text())
            (folder / record).write_text(hostile(content, rng, root / MINE[0]))
            try:
                write()
            except SupersamplerError:
                pass
            finally:
                kept = {path: path.read_bytes() for path in mine if path.exists()}
                changed = [path for path, data in mine.items() if kept.get(path) != data]
                if changed:
                    raise AssertionError(f"changed: {changed[0].relative_to(root)}")

    os.environ.setdefault("OMP_NUM_THREADS", "1")
    assert RECORDED.is_dir()
    return run


def test_no_record_makes_a_writer_touch_files_of_others() -> None:
    assert run_apart(prepare, examples(16), memory=4 << 30, seconds=60.0) == []
