"""The host in C refuses a folder that was tampered with, in one line, before it steps."""

import json
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from c_host import stubbed_or_skip
from commands import finished
from json_edits import GONE, edited
from supersampler_export.shaders.folder import write_shader_folder

DISPLAY, SIZES = (8, 6), ((4, 3), (5, 4), (5, 4))
CHANNELS = {"color": 4, "depth": 1, "motion": 2}

Case = tuple[Sequence[str | int], Any, str]
"""A place in the JSON, the value there, and a part of the message."""

SHADERS: dict[str, Case] = {
    "another format": (["format"], "other", "want supersampler-shaders version 3"),
    "another target": (["target"], "spirv", "want shaders in WGSL"),
    "no passes": (["passes"], [], "want a list of 1 to 64 items"),
    "too many resources": (["resources"], [{}] * 65, "want a list of 1 to 64 items"),
    "a resource that is not an object": (["resources", 0], 5, "want a value"),
    "a resource that is gone": (["resources", "measured"], GONE, "want the name of a resource"),
    "a resource twice": (["resources", "awake", "name"], "measured", "want another name for each"),
    "an unknown role": (["resources", "awake", "role"], "x", "want one of: params, weights, history"),
    "an unknown kind": (["resources", "awake", "kind"], "x", "want one of: uniform, buffer, texture"),
    "an unknown format of a texture": (["resources", "dilated", "format"], "x", "want one of: rgba32float"),
    "bytes < 0": (["resources", "measured", "bytes"], -1, "want a whole number from 0 to 268435456"),
    "bytes without an end": (["resources", "measured", "bytes"], 1e300, "want a whole number from 0 to"),
    "a fraction of a byte": (["resources", "measured", "bytes"], 0.5, "want a whole number from 0 to"),
    "a division by 0": (["passes", 2, "covers", "divide"], 0, "want a whole number from 1 to 16384"),
    "a huge size": (["resources", "light", "size", "multiply"], [16384, 1], "want at most 65535 pixels"),
    "a size of 0": (["resources", "samples", "size", "multiply"], [0, 1], "want two whole numbers from 1"),
    "a size of an unknown base": (["passes", 2, "covers", "of"], "x", "want one of: one, render, previous"),
    "a tile of 0": (["passes", 2, "tile"], [0, 16], "want two whole numbers from 1 to 16384"),
    "a pair the wrong way round": (["history", "pairs", 0], ["next_state", "history_state"], "want one of"),
    "too many pairs": (["history", "pairs"], [["a", "b"]] * 5000, "want a list of 0 to 32 items"),
    "a history outside of pairs": (["resources", "measured", "role"], "history", 'want one of "pairs"'),
    "a history of other memory": (["resources", "next_power", "bytes"], 8, "want the same kind, format and"),
    "weights without a file": (["resources", "network0", "file"], GONE, "want a value"),
    "weights in a texture": (["resources", "network0", "kind"], "texture", 'want "uniform" or'),
    "weights of other bytes": (["resources", "network0", "bytes"], 4, "bytes; want 4;"),
    "weights of odd bytes": (["resources", "network0", "bytes"], 3, "want a multiple of 4"),
    "weights from elsewhere": (["resources", "network0", "file"], "../../etc/passwd", "want the name of"),
    "a shader from elsewhere": (["passes", 0, "file"], "/etc/passwd", "want the name of a file in the same"),
    "a shader of another drive": (["passes", 0, "file"], "C:a.wgsl", "want the name of a file in the same"),
    "a shader that is the folder": (["passes", 0, "file"], "..", "want the name of a file in the same"),
    "a shader without a name": (["passes", 0, "file"], "", "want the name of a file in the same folder"),
    "a shader that is not there": (["passes", 0, "file"], "x.wgsl", "x.wgsl: cannot be opened"),
    "a group too high": (["passes", 0, "bindings", 0, "group"], 5000, "want a whole number from 0 to 1"),
    "a gap of groups": (["passes", 2, "bindings"], [
        {"group": 1, "binding": 0, "resource": "params", "kind": "uniform"}
    ], "want group 0 before group 1"),
    "too many bindings": (["passes", 2, "bindings"], [{}] * 65, "want a list of 1 to 64 items"),
    "a binding twice": (["passes", 0, "bindings", 1, "binding"], 0, "want another in each"),
    "a resource bound twice": (["passes", 1, "bindings", 3, "resource"], "history_state", "want another in"),
    "a binding to nothing": (["passes", 0, "bindings", 1, "resource"], "x", "want the name of a resource"),
    "a texture bound as a buffer": (["passes", 0, "bindings", 1, "resource"], "dilated", "binds as"),
    "a buffer bound as a texture": (["passes", 0, "bindings", 1, "kind"], "texture", 'binds as "texture"'),
    "a frame that is written": (["passes", 0, "bindings", 2], {
        "group": 1, "binding": 0, "resource": "frame_color", "kind": "storage-texture", "format": "rg32uint"
    }, 'binds as "storage-texture"'),
    "an image that is read": (["passes", 0, "bindings", 2, "resource"], "image", 'binds as "texture"'),
    "an image of another format": (["resources", "image", "format"], "rgba32float", 'want "rgba16float"'),
    "floats bound as integers": (["passes", 0, "bindings", 2, "kind"], "uint-texture", "binds as"),
    "an unknown binding": (["passes", 0, "bindings", 1, "kind"], "x", "want one of: uniform, storage"),
    "params gone": (["params", "resource"], "x", "want the name of a resource"),
    "params too small": (["resources", "params", "bytes"], 16, 'role "params" with 64 bytes'),
    "params that are not theirs": (["params", "resource"], "measured", 'want a uniform of role "params"'),
    "a frame in a buffer": (["resources", "frame_color", "kind"], "buffer", 'want "texture"'),
    "an unknown frame": (["resources", "awake"], {
        "name": "frame_x", "role": "frame", "kind": "texture",
        "size": {"of": "render", "divide": 1, "multiply": [1, 1]},
    }, "want one of: frame_color, frame_depth, frame_motion, frame_reactive"),
    "no entry point": (["passes", 0, "entry_point"], None, "want a text"),
}  # fmt: skip

FRAMES: dict[str, Case] = {
    "no display": (["display"], GONE, "want a value"),
    "a display of 0": (["display"], [0, 6], "want two whole numbers from 1 to 16384"),
    "no frames": (["frames"], [], "want a list of 1 to 65536 items"),
    "a frame that is not an object": (["frames", 1], 5, "want a value"),
    "a frame without an end": (["frames", 1, "size"], [1e300, 3], "want two whole numbers from 1 to 16384"),
    "a frame of other pixels": (["frames", 1, "size"], [4, 4], "1.color: 320 bytes; want 256;"),
    "a jitter of other pixels": (["frames", 1, "jitter"], [0, 1e300], "want two numbers from -0.5 to 0.5"),
    "an exposure without an end": (["frames", 1, "exposure"], 1e300, "want a number from 0 to"),
    "no pre-exposure": (["frames", 1, "pre_exposure"], GONE, "want a value"),
    "a pre-exposure of 0": (["frames", 1, "pre_exposure"], 0, "want a number from 5.96046e-08 to"),
    "a reset that is neither": (["frames", 1, "reset"], 1, "want true or false"),
    "a plane from elsewhere": (["frames", 1, "color"], "../frames/0.color", "want the name of a file"),
}


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return stubbed_or_skip(tmp_path_factory.mktemp("stubbed"))


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the shaders of two methods, and frames."""
    root = tmp_path_factory.mktemp("exported")
    for method in ("taau", "classifier-small"):
        write_shader_folder(method, root / method)
    frames = []
    (root / "frames").mkdir()
    for index, (width, height) in enumerate(SIZES):
        files = {name: f"{index}.{name}" for name in CHANNELS}
        for name, count in CHANNELS.items():
            (root / "frames" / files[name]).write_bytes(bytes(4 * count * width * height))
        exposure = 1.5 if index == 1 else None
        frame = {"jitter": [0.125, -0.25], "exposure": exposure, "pre_exposure": 1.0, "reset": index == 2}
        frames.append({**frame, "size": [width, height], **files})
    (root / "frames" / "frames.json").write_text(json.dumps({"display": DISPLAY, "frames": frames}))
    return root


def run(program: Path, root: Path, method: str = "taau") -> "subprocess.CompletedProcess[str]":
    (root / "out").mkdir(exist_ok=True)
    command = (program, root / method, root / "frames", root / "out")
    return finished(*command, ASAN_OPTIONS="detect_leaks=0")


def assert_refused(done: "subprocess.CompletedProcess[str]", message: str) -> None:
    """The host exits with one line that has the message."""
    assert done.returncode == 1, done.stderr
    assert message in done.stderr
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1


def change(file: Path, path: Sequence[str | int], value: Any) -> None:
    file.write_bytes(edited(json.loads(file.read_text()), path, value))


@pytest.mark.parametrize("method", ["taau", "classifier-small"])
def test_a_folder_as_it_was_exported_is_stepped(program: Path, exported: Path, method: str) -> None:
    done = run(program, exported, method)
    assert done.returncode == 0, done.stderr
    assert len(list((exported / "out").glob("*.rgba16f"))) == len(SIZES)


@pytest.mark.parametrize("case", SHADERS)
def test_a_tampered_folder_is_refused(program: Path, exported: Path, tmp_path: Path, case: str) -> None:
    path, value, message = SHADERS[case]
    method = "classifier-small" if "network0" in path else "taau"
    shutil.copytree(exported, tmp_path, dirs_exist_ok=True)
    change(tmp_path / method / "upscaler.json", path, value)
    assert_refused(run(program, tmp_path, method), message)


@pytest.mark.parametrize("case", FRAMES)
def test_tampered_frames_are_refused(program: Path, exported: Path, tmp_path: Path, case: str) -> None:
    shutil.copytree(exported, tmp_path, dirs_exist_ok=True)
    path, value, message = FRAMES[case]
    change(tmp_path / "frames" / "frames.json", path, value)
    assert_refused(run(program, tmp_path), message)


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("taau/upscaler.json", b"", "is no JSON"),
        ("taau/upscaler.json", b"[" * 100_000, "is no JSON"),
        ("taau/upscaler.json", b"[]", "want a value"),
        ("taau/upscaler.json", b'"\xff"', "is no UTF-8"),
        ("taau/upscaler.json", None, "cannot be opened"),
        ("taau/00_measure.wgsl", b"\xff\xfe", "is no UTF-8"),
        ("taau/00_measure.wgsl", b"// \xc0\xaf", "is no UTF-8"),
        ("taau/00_measure.wgsl", bytes((1 << 24) + 1), "16777217 bytes; want at most 16777216"),
        ("taau/00_measure.wgsl", Path("a folder"), "00_measure.wgsl: "),
        ("frames/frames.json", b"{", "is no JSON"),
        ("frames/1.depth", bytes(79), "1.depth: 79 bytes; want 80;"),
        ("frames/1.depth", None, "1.depth: cannot be opened"),
    ],
)
def test_a_damaged_file_is_refused_by_name(
    program: Path, exported: Path, tmp_path: Path, file: str, content: bytes | Path | None, message: str
) -> None:
    shutil.copytree(exported, tmp_path, dirs_exist_ok=True)
    (tmp_path / file).unlink()
    if isinstance(content, bytes):
        (tmp_path / file).write_bytes(content)
    elif content is not None:
        (tmp_path / file).mkdir()
    assert_refused(run(program, tmp_path), message)


def test_a_frame_without_the_aovs_that_shaders_blend_is_refused(program: Path, exported: Path) -> None:
    write_shader_folder("taa", exported / "aovs", aovs=4)
    assert_refused(run(program, exported, "aovs"), "frame_aovs0 is NULL; a pass of the folder binds it")
