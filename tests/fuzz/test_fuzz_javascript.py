"""Fuzz tests of the readers in JavaScript: files are read, or refused with our own errors."""

import json
import re
import shutil
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fuzzing import damaged, dumped, examples, replaced, with_other_numbers
from javascript_cases import answers, write_tiny
from supersampler.io.images import write_exr
from supersampler.io.shot import Shot
from supersampler_export.shaders.folder import write_shader_folder

BATCH = 250
STRINGS = (
    "https://example.invalid/x", "//example.invalid/x", "%2e%2e/x", "a/../../x", "/x", "x:y", "a\\b", "", ".",
    "__proto__", "constructor", "toString", "length", "params", "image", "history_pixels", "display", "one",
)  # fmt: skip

IDENTITY = ("format", "version", "target", "images")
"""Keys of JSON files that say what they are."""

Files = dict[str, bytes]
Mutate = Callable[[np.random.Generator], Files]


def read_cases(kind: str, base: Path, mutate: Mutate, count: int, work: Path) -> None:
    """Read cases 0 to `count`; `mutate` returns the files that a case replaces.

    A case seeds its generator by its number. Errors of other classes than the readers' own, too much memory
    and hangs fail the test.
    """
    for first in range(0, count, BATCH):
        numbers = range(first, min(first + BATCH, count))
        cases = [mutate(np.random.default_rng(number)) for number in numbers]
        answers(kind, base, cases, work, seconds=60.0 + len(cases))


# --- files and their changes ---


def write_images(folder: Path) -> None:
    shipped = Shot.open("plaza").source
    shutil.copyfile(shipped / "0000.exr", folder / "plaza.exr")
    rng = np.random.default_rng(0)
    image = {
        name: rng.random((37, 21)).astype(np.float16 if index % 2 else np.float32)
        for index, name in enumerate(("R", "G", "B", "depth.Z", "motion.X"))
    }
    for compression in ("zip", "zips", "none", "piz"):
        write_exr(folder / f"{compression}.exr", image, compression=compression)


def with_other_blocks(data: bytes, rng: np.random.Generator) -> bytes:
    """Have some blocks share their bytes, and others inflate to a thousand times what they are."""
    table = 8
    while data[table]:  # an attribute: name, type, size, value
        size_at = data.index(b"\0", data.index(b"\0", table) + 1) + 1
        table = size_at + 4 + int.from_bytes(data[size_at : size_at + 4], "little")
    table += 1
    content = bytearray(data)
    count = (int.from_bytes(data[table : table + 8], "little") - table) // 8
    bomb = zlib.compress(bytes(int(rng.choice([1 << 12, 1 << 20, 1 << 26]))))
    chance = rng.random()
    for index in range(count):
        at = table + 8 * index
        if rng.random() > chance:
            continue
        if rng.random() < 0.2:
            other = table + 8 * int(rng.integers(count))
            content[at : at + 8] = content[other : other + 8]
            continue
        begins = int.from_bytes(data[at : at + 8], "little")
        content[at : at + 8] = len(content).to_bytes(8, "little")
        content += data[begins : begins + 4] + len(bomb).to_bytes(4, "little") + bomb
    return bytes(content)


def mutated_json(data: bytes, rng: np.random.Generator) -> bytes:
    if rng.random() < 0.2:
        return damaged(data, rng)
    content: Any = json.loads(data)
    for _ in range(int(rng.integers(1, 4))):
        content = replaced(content, rng)
    if isinstance(content, dict) and rng.random() < 0.8:  # else most readers stop at these
        content |= {key: value for key, value in json.loads(data).items() if key in IDENTITY}
    text = dumped(content).decode()
    if rng.random() < 0.3 and (found := list(re.finditer(r'"[^"\\]*"', text))):
        one = found[int(rng.integers(len(found)))]
        other = json.dumps(STRINGS[int(rng.integers(len(STRINGS)))])
        text = text[: one.start()] + other + text[one.end() :]
    return text.encode()


def test_no_exr_harms_the_page(tmp_path: Path) -> None:
    (tmp_path / "none").mkdir()
    (tmp_path / "images").mkdir()
    write_images(tmp_path / "images")
    files = [path.read_bytes() for path in sorted((tmp_path / "images").iterdir())]

    def mutate(rng: np.random.Generator) -> Files:
        data = files[int(rng.integers(len(files)))]
        match int(rng.integers(3)):
            case 0:
                return {"a.exr": damaged(data, rng)}
            case 1:
                return {"a.exr": with_other_numbers(data, rng, 900)}
            case _:
                return {"a.exr": with_other_blocks(data, rng)}

    read_cases("images", tmp_path / "none", mutate, examples(120), tmp_path)


def test_no_shot_harms_the_page(tmp_path: Path) -> None:
    text = write_tiny(tmp_path / "tiny")

    def mutate(rng: np.random.Generator) -> Files:
        return {"shot.json": mutated_json(text, rng)}

    read_cases("shot", tmp_path / "tiny", mutate, examples(120), tmp_path)


@pytest.mark.parametrize("method", ["taau", "classifier"])
def test_no_folder_of_shaders_harms_its_host(tmp_path: Path, method: str) -> None:
    write_shader_folder(method, tmp_path / "shaders")
    text = (tmp_path / "shaders" / "upscaler.json").read_bytes()

    def mutate(rng: np.random.Generator) -> Files:
        return {"upscaler.json": mutated_json(text, rng)}

    read_cases("shaders", tmp_path / "shaders", mutate, examples(120), tmp_path)
