"""Fuzz tests of the readers in JavaScript: files are read, or refused with our own errors."""

import json
import queue
import re
import shutil
import subprocess
import sys
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
import pytest

from fuzzing import FINDINGS, damaged, dumped, examples, replaced, with_other_numbers
from noise import noise
from supersampler.io.images import write_exr
from supersampler.io.shot import Shot, ShotWriter
from supersampler_export.shaders.folder import write_shader_folder

RUNNER = Path(__file__).parent / "javascript" / "read_cases.mjs"
MIN_NODE = 18  # it has DecompressionStream
PEAK = 600 << 20
"""Bytes of memory of the process in Node, which takes 100 MiB without a case."""
RUNAWAY = 2 * PEAK
"""Bytes at which a case is stopped before it ends."""
SECONDS = 10.0
HEAP = "--max-old-space-size=256"  # MiB
BATCH = 250
STRINGS = (
    "https://example.invalid/x", "//example.invalid/x", "%2e%2e/x", "a/../../x", "/x", "x:y", "a\\b", "", ".",
    "__proto__", "constructor", "toString", "length", "params", "image", "history_pixels", "display", "one",
)  # fmt: skip

IDENTITY = ("format", "version", "target", "images")
"""Keys of JSON files that say what they are."""

Files = dict[str, bytes]
Mutate = Callable[[np.random.Generator], Files]


def node_or_skip() -> str:
    node = shutil.which("node")
    if node is None:
        pytest.skip("Node.js is not installed here")
    version = subprocess.run([node, "--version"], check=True, capture_output=True, text=True).stdout
    if int(version.strip("v\n").partition(".")[0]) < MIN_NODE:
        pytest.skip(f"Node.js {version.strip()} is older than {MIN_NODE}, and has no DecompressionStream")
    return node


def run_cases(kind: str, base: Path, mutate: Mutate, count: int, work: Path) -> list[str]:
    """Read cases 0 to `count` in child processes, and return a line for each that went wrong.

    Args:
        kind: key of READERS in read_cases.mjs.
        base: folder of the whole files.
        mutate: returns the files to replace, by a generator that is seeded with the case's number.
        count: number of cases.
        work: folder for the cases.
    """
    node, first = node_or_skip(), 0
    findings: list[str] = []
    while first < count and len(findings) < FINDINGS:
        end = min(first + BATCH, count)
        cases = work / f"{kind}{first}"
        for case in range(first, end):
            for name, data in mutate(np.random.default_rng(case)).items():
                (cases / str(case) / name).parent.mkdir(parents=True, exist_ok=True)
                (cases / str(case) / name).write_bytes(data)
        while first < end and len(findings) < FINDINGS:
            arguments = [kind, str(base), str(cases), str(first), str(end), str(PEAK)]
            last, found = watch([node, HEAP, str(RUNNER), *arguments])
            findings += found
            first = last + 1
        shutil.rmtree(cases)
    return findings


def watch(command: list[str]) -> tuple[int, list[str]]:
    """Run a child and kill it where a case takes too long or too much; return its last case and findings."""
    findings: list[str] = []
    case, is_over = -1, True
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        assert child.stderr is not None
        errors: list[str] = []
        reading = threading.Thread(target=lambda stream: errors.extend(stream), args=[child.stderr])
        reading.start()
        for line in lines_of(child, child.stdout):
            if isinstance(line, str):
                child.kill()
                findings.append(f"case {case}: {line}")
                is_over = True
                break
            case, is_over = line["case"], len(line) > 1
            if "raised" in line:
                findings.append(f"case {case}: {line['raised']}")
        reading.join()
    if case < 0:
        raise RuntimeError(f"no case began: {''.join(errors)[-2000:]}")
    if not is_over or (child.returncode not in (0, 3) and not findings):
        findings.append(f"case {case}: exit {child.returncode}: {''.join(errors)[-600:]}")
    return case, findings


def lines_of(child: "subprocess.Popen[str]", stream: IO[str]) -> Iterator[dict[str, Any] | str]:
    """Yield the lines of a child; a text, as the last one, where it must be stopped."""
    lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()

    def read() -> None:
        for line in stream:
            lines.put(line)
        lines.put(None)

    threading.Thread(target=read, daemon=True).start()
    until = time.monotonic() + SECONDS
    while True:
        try:
            line = lines.get(timeout=0.05)
        except queue.Empty:
            if time.monotonic() > until:
                yield "hung"
                return
            if (taken := resident(child.pid)) > RUNAWAY:
                yield f"takes {taken >> 20} MiB of memory, and more"
                return
            continue
        if line is None:
            return
        yield json.loads(line)
        until = time.monotonic() + SECONDS


def resident(process: int) -> int:
    """Return the bytes of memory that a process has; 0 where that is not known."""
    if sys.platform != "linux":
        return 0
    try:
        return int(Path(f"/proc/{process}/status").read_text().partition("VmRSS:")[2].split()[0]) << 10
    except (OSError, IndexError):  # it has just ended
        return 0


# --- files and their changes ---


def write_tiny(folder: Path) -> None:
    """Write a shot of two frames in this package's conventions, one with a reference."""
    with ShotWriter(folder, name="tiny", display_size=(64, 36), frame_rate=30) as writer:
        writer.write(noise(0))
        writer.write(noise(1, exposure=0.5), reference=np.zeros((36, 64, 3), np.float32))


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

    assert run_cases("images", tmp_path / "none", mutate, examples(120), tmp_path) == []


def test_no_shot_harms_the_page(tmp_path: Path) -> None:
    write_tiny(tmp_path / "tiny")
    text = (tmp_path / "tiny" / "shot.json").read_bytes()

    def mutate(rng: np.random.Generator) -> Files:
        return {"shot.json": mutated_json(text, rng)}

    assert run_cases("shot", tmp_path / "tiny", mutate, examples(120), tmp_path) == []


@pytest.mark.parametrize("method", ["taau", "classifier"])
def test_no_folder_of_shaders_harms_its_host(tmp_path: Path, method: str) -> None:
    write_shader_folder(method, tmp_path / "shaders")
    text = (tmp_path / "shaders" / "upscaler.json").read_bytes()

    def mutate(rng: np.random.Generator) -> Files:
        return {"upscaler.json": mutated_json(text, rng)}

    assert run_cases("shaders", tmp_path / "shaders", mutate, examples(120), tmp_path) == []
