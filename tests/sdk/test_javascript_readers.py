"""The JavaScript readers refuse malicious files with typed errors, in little memory."""

import hashlib
import json
import re
import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commands import ran
from javascript_cases import NODE, answers, write_tiny
from json_edits import GONE, edited
from method_lists import WITH_SHADERS
from supersampler.io.images import Channel, write_exr
from supersampler.io.shot import Shot
from supersampler_export.shaders.folder import write_shader_folder

TESTS = Path(__file__).parents[1]
CHECKS = TESTS / "sdk" / "javascript_readers.mjs"
HALF, FLOAT = 1, 2


def others_than(said: Sequence[str], wanted: Mapping[str, str]) -> dict[str, str]:
    """Return what does not contain what is wanted, by the case's name."""
    pairs = zip(wanted.items(), said, strict=True)
    return {name: text for (name, part), text in pairs if part not in text}


# --- EXR ---


def attribute(name: str, kind: str, value: bytes) -> bytes:
    return f"{name}\0{kind}\0".encode() + struct.pack("<i", len(value)) + value


def channel_list(channels: Sequence[tuple[str, int]]) -> bytes:
    return b"".join(f"{name}\0".encode() + struct.pack("<iiii", kind, 0, 1, 1) for name, kind in channels)


def exr(
    size: tuple[int, int], blocks: Sequence[bytes], *, channels: Sequence[tuple[str, int]] = (("R", HALF),),
    compression: int = 3, rows: int = 16, window: Sequence[int] = (),
    change: Callable[[dict[str, bytes]], object] = lambda _: None,
    offsets: Callable[[list[int]], list[int]] = lambda found: found,
) -> bytes:  # fmt: skip
    """Return an EXR file of these blocks as they are; `change` edits its attributes, `offsets` its table."""
    box = struct.pack("<iiii", *(window or (0, 0, size[0] - 1, size[1] - 1)))
    attributes = {
        "channels": attribute("channels", "chlist", channel_list(channels) + b"\0"),
        "compression": attribute("compression", "compression", bytes([compression])),
        "dataWindow": attribute("dataWindow", "box2i", box),
        "displayWindow": attribute("displayWindow", "box2i", box),
    }
    change(attributes)
    header = struct.pack("<II", 20000630, 2) + b"".join(attributes.values()) + b"\0"
    at, found, body = len(header) + 8 * len(blocks), [], b""
    for index, block in enumerate(blocks):
        found.append(at + len(body))
        body += struct.pack("<ii", rows * index, len(block)) + block
    return header + struct.pack(f"<{len(blocks)}Q", *offsets(found)) + body


def nested() -> bytes:
    """Return a file of two blocks without compression, of which the second lies within the first."""
    data = bytearray(exr((8, 2), [bytes(16), bytes(16)], compression=0, rows=1))
    first = data.index(struct.pack("<ii", 0, 16))
    data[first - 8 : first] = struct.pack("<Q", first + 8)  # the table's last entry
    data[first + 8 : first + 16] = struct.pack("<ii", 1, 16)
    return bytes(data)


def attacks_by_images() -> dict[str, tuple[bytes, str]]:
    rows = zlib.compress(bytes(8 * 16 * 2))  # of 8 x 16 half floats
    wide = [(name, FLOAT) for name in "ABCD"]
    bomb = zlib.compress(bytes(128 << 20), 9)  # fewer bytes than 1024 x 16 x 4 floats are
    endless = attribute("channels", "chlist", channel_list([("R", HALF)]))

    def changed(**attributes: bytes) -> bytes:
        return exr((8, 16), [rows], change=lambda found: found.update(attributes))

    many = {f"a{index}": attribute(f"a{index}", "int", bytes(4)) for index in range(1100)}
    return {
        "a bomb in each block": (
            exr((1024, 96), [bomb] * 6, channels=wide), "a block becomes more than 262144 bytes"
        ),
        "a block in another": (nested(), "have bytes of something else"),
        "a block in the header": (exr((8, 16), [rows], offsets=lambda _: [8]), "damaged"),
        "more bytes in the file than pixels": (exr((8, 16), [bytes(300)]), "are 300 bytes"),
        "a block beyond the end": (exr((8, 16), [rows])[:-1], "rows from 0 on reach beyond its end"),
        "an offset beyond all": (
            exr((8, 16), [rows], offsets=lambda _: [2**64 - 1]), "damaged or cut off (Offset is outside"
        ),
        "rows of another block": (
            exr((8, 32), [rows, rows], offsets=lambda found: found[::-1]), "the block of row 0 states row 16"
        ),
        "too little": (exr((8, 16), [zlib.compress(bytes(10))]), "a block becomes 10 bytes; want 256"),
        "a stream cut off": (exr((8, 16), [zlib.compress(bytes(256))[:-3]]), "damaged or cut off"),
        "a large image in a small file": (
            exr((16384, 4096), [b"\0" * 9] * 256), "are 9 bytes, which cannot be 524288"
        ),
        "a thousand channels in a small file": (
            exr((16384, 8192), [], channels=[(f"c{index}", FLOAT) for index in range(1000)]),
            "MiB of pixels; this page reads at most 1024",
        ),
        "too many channels": (
            exr((1, 1), [], channels=[(f"c{index}", HALF) for index in range(5000)]),
            "has more than 4096 channels",
        ),
        "a side beyond the limit": (exr((40000, 1), []), "is 40000 x 1; want 1 to 32768 pixels a side"),
        "pixels beyond the limit": (exr((32768, 32768), []), "is 32768 x 32768; want"),
        "an empty window": (exr((8, 16), [], window=(0, 0, -1, 15)), "is 0 x 16; want"),
        "no window": (changed(dataWindow=b""), "it has no dataWindow"),
        "an empty list of channels": (exr((8, 16), [rows], channels=[]), "it has no channels"),
        "a list of channels without end": (changed(channels=endless), "cut off (Offset is outside"),
        "a channel twice": (
            exr((8, 16), [zlib.compress(bytes(512))], channels=[("R", HALF)] * 2), "it has channel R twice"
        ),
        "an attribute twice": (
            changed(again=attribute("compression", "compression", b"\3")), "it has compression twice"
        ),
        "too many attributes": (changed(**many), "it has more than 1024 attributes"),
        "a long name": (changed(n=attribute("n" * 300, "int", bytes(4))), "a name of more than 255 bytes"),
        "an attribute of a negative size": (
            changed(bad=b"bad\0int\0" + struct.pack("<i", -20)), "damaged or cut off ("
        ),
        "a negative sampling": (
            exr((8, 16), [rows]).replace(struct.pack("<iii", 0, 1, 1), struct.pack("<iii", 0, -1, -1)),
            "channel R is of whole numbers or subsampled",
        ),
    }  # fmt: skip


def test_malicious_images_are_refused_with_the_reason(tmp_path: Path) -> None:
    attacks = attacks_by_images()
    said = read_images(tmp_path, [data for data, _ in attacks.values()])
    assert others_than(said, {name: text for name, (_, text) in attacks.items()}) == {}
    assert all(text.startswith("ExrError: a.exr: ") for text in said)


def read_images(work: Path, images: Sequence[bytes]) -> list[str]:
    (work / "none").mkdir()
    return answers("images", work / "none", [{"a.exr": data} for data in images], work)


def test_whole_images_are_read(tmp_path: Path) -> None:
    rng, path = np.random.default_rng(0), tmp_path / "a.exr"
    half = rng.random((37, 21)).astype(np.float16)
    image: dict[str, Channel] = {"R": half, "depth.Z": rng.random((37, 21), np.float32)}
    image["again"] = half * np.float16(1000.0)
    whole = "read " + hashlib.sha256(b"".join(image[name].tobytes() for name in sorted(image))).hexdigest()
    packed: dict[str, Channel] = {"R": np.zeros((2048, 2048), np.float32)}  # as well as zlib can
    cases = []
    for content, compression in ((image, "none"), (image, "zips"), (image, "zip"), (packed, "zip")):
        write_exr(path, content, compression=compression)
        cases.append(path.read_bytes())
    cases.append(exr((8, 16), [zlib.compress(bytes(256))]))
    cases.append((Shot.open("plaza").source / "0000.exr").read_bytes())
    said = read_images(tmp_path, cases)
    assert said[:3] == [whole] * 3
    assert all(one.startswith("read ") for one in said)


# --- JSON ---


Edit = tuple[Sequence[str | int], Any]
"""A place in a JSON file, and the value put there."""


def frames(*keys: str | int) -> Sequence[str | int]:
    return ("frames", 0, *keys)


BELOW = "want a file inside the shot's folder"
SHOT_EDITS: dict[str, tuple[Edit, str]] = {
    "a name that leaves the folder": ((frames("file"), "../x.exr"), BELOW),
    "a name that leaves it later": ((frames("file"), "a/../../x.exr"), BELOW),
    "an address": ((frames("file"), "https://example.invalid/x.exr"), BELOW),
    "a name with backslashes": ((frames("file"), "..\\x.exr"), BELOW),
    "a reference that leaves the folder": ((frames("reference"), "../x.exr"), BELOW),
    "a long name": ((frames("file"), "é" * 200), BELOW),
    "an invalid name": ((frames("file"), ["0000.exr"]), "frames[0].file is"),
    "no name": ((frames("file"), GONE), "frames[0].file is undefined"),
    "no frames": ((("frames",), []), "want a list of 1 to 1048576 items"),
    "invalid frames": ((("frames",), {"length": 5}), "frames is {"),
    "an invalid frame": ((("frames", 0), None), "frames[0] is null; want an object"),
    "a huge size": ((("render_size",), [10**9, 10**9]), "want 1 to 32768 pixels a side"),
    "many pixels": ((("display_size",), [32768, 32768]), "want 1 to 32768 pixels a side"),
    "a size of text": ((("render_size",), ["32", 18]), "render_size[0] is"),
    "a size of fractions": ((frames("render_size"), [0.5, 18]), "frames[0].render_size[0] is 0.5"),
    "a frame of one pixel": ((frames("render_size"), [1, 1]), "is at most 8 times"),
    "a display much larger": ((("display_size",), [32000, 18]), "is at most 8 times"),
    "jitter beyond a pixel": ((frames("jitter"), [0.75, 0]), "frames[0].jitter[0] is 0.75"),
    "no jitter": ((frames("jitter"), GONE), "frames[0].jitter is undefined"),
    "a negative exposure": ((frames("exposure"), -1), "frames[0].exposure is -1; want a number > 0"),
    "an exposure that is 0 in single precision": ((frames("exposure"), 1e-60), "want a number > 0"),
    "an invalid reset": ((frames("reset"), 1), "frames[0].reset is 1; want true or false"),
    "an invalid name of the shot": ((("name",), {"toString": 1}), "name is {"),
    "invalid conventions": ((("conventions",), "x"), "conventions is"),
    "other conventions": ((("conventions", "depth"), "linear"), "conventions of its own (depth)"),
    "another version": ((("version",), 2), "version is 2; want 1"),
}  # fmt: skip


def test_an_invalid_shot_json_is_refused_by_field(tmp_path: Path) -> None:
    content = json.loads(write_tiny(tmp_path / "shot"))
    cases = [{"shot.json": edited(content, *edit)} for edit, _ in SHOT_EDITS.values()]
    said = answers("shot", tmp_path / "shot", cases, tmp_path)
    assert others_than(said, {name: text for name, (_, text) in SHOT_EDITS.items()}) == {}
    assert all(text.startswith("ShotError: shot.json") for text in said)


def test_a_shot_is_read_and_its_images_are_compared_with_what_it_says(tmp_path: Path) -> None:
    content = json.loads(write_tiny(tmp_path / "shot"))
    without_rate = json.loads(edited(content, ("frame_rate",), None))
    large = exr((8192, 8192), [zlib.compress(bytes(8192 * 32))] * 512)
    cases: list[dict[str, bytes]] = [
        {},
        {"shot.json": edited(without_rate, frames("exposure"), None)},
        {"0000.exr": large},
        {"shot.json": b"[" * 200_000},
        {"shot.json": b'{"version": ' + b"[" * 100_000 + b"]" * 100_000 + b"}"},
        {"shot.json": b" " * (17 << 20)},
    ]  # fmt: skip
    wanted = {
        "as it was written": "read",
        "with values that may be null": "read",
        "a frame of another size": "ShotError: 0000.exr is 8192 x 8192; shot.json says 32 x 18.",
        "a list without end": "ShotError: shot.json: the file is no JSON",
        "a list in many": "ShotError: shot.json: version is a value that JSON cannot hold",
        "too large a file": "ShotError: shot.json is larger than 16 MiB.",
    }
    assert others_than(answers("shot", tmp_path / "shot", cases, tmp_path), wanted) == {}


SIZE = {"of": "display", "divide": 1, "multiply": [1, 1]}
WORK = {"name": "more", "role": "work", "kind": "buffer", "size": SIZE, "bytes": 4}


def shader_edits(content: dict[str, Any]) -> dict[str, tuple[Edit, str]]:
    at = {one["name"]: index for index, one in enumerate(content["resources"])}
    work = at["measured"]
    texture = at["samples"]
    size = ("resources", work, "size")
    binding = ("passes", 0, "bindings", 0)
    return {
        "a division by 0": (((*size, "divide"), 0), f"resources[{work}].size.divide is 0; want"),
        "a base that is not there": (((*size, "of"), "__proto__"), f"resources[{work}].size.of is"),
        "a factor of text": (((*size, "multiply"), ["1", 1]), "multiply[0] is"),
        "a huge factor": (((*size, "multiply"), [1 << 16, 1 << 16]), "which needs"),
        "a huge texture": ((("resources", texture, "size", "multiply"), [1 << 16, 1]), "in one direction"),
        "bytes without end": ((("resources", work, "bytes"), 1 << 40), f"resources[{work}].bytes is"),
        "an invalid format": ((("resources", texture, "format"), "rgba8"), "format is"),
        "an invalid role": ((("resources", work, "role"), "constructor"), f"resources[{work}].role is"),
        "an invalid kind": ((("resources", work, "kind"), "toString"), f"resources[{work}].kind is"),
        "a name twice": ((("resources", work, "name"), "samples"), "want a name of one resource"),
        "no params": ((("resources", at["params"], "role"), "work"), "kind is"),
        "params of another size": ((("resources", at["params"], "bytes"), 32), "bytes is 32; want 64"),
        "an invalid field": ((("params", "fields", 0, "name"), "constructor"), "fields[0].name is"),
        "a field outside of params": ((("params", "fields", 0, "offset"), 60), "fields[0].offset is 60"),
        "params without end": ((("params", "bytes"), 1 << 40), "params.bytes is"),
        "tiles of 0": ((("passes", 0, "tile"), [0, 1]), "passes[0].tile[0] is 0"),
        "more workgroups than there are": ((("passes", 0, "covers", "multiply"), [1 << 16, 1]), "workgroups"),
        "a file that leaves the folder": ((("passes", 0, "file"), "../x.wgsl"), "passes[0].file is"),
        "weights of another length": ((("resources", at["network0"], "bytes"), 4), "want at most 4 bytes"),
        "work with a file": ((("resources", work, "file"), "network0.bin"), f"resources[{work}].file is"),
        "a binding of nothing": (((*binding, "resource"), "nothing"), "want a name among resources"),
        "a binding of another kind": (((*binding, "kind"), "texture"), "passes[0].bindings[0].kind is"),
        "a gap in the groups": ((("passes", 0, "bindings", 2, "group"), 3), "want a list of groups"),
        "a group beyond the limit": (((*binding, "group"), 4), "passes[0].bindings[0].group is 4"),
        "a binding twice": ((("passes", 0, "bindings", 1, "binding"), 0), "want a binding of its own"),
        "more passes than are read": ((("passes",), content["passes"][:1] * 300), "a list of 1 to 256 items"),
        "more resources than are read": ((("resources",), [WORK] * 300), "want a list of 1 to 256 items"),
        "a pair twice": (
            (("history", "pairs"), [*content["history"]["pairs"], content["history"]["pairs"][0]]),
            "in one pair",
        ),
        "no pairs": ((("history", "pairs"), []), "want a list with history_"),
        "invalid ratios": ((("ratios",), [0, 3]), "ratios[0] is 0"),
        "ratios in another order": ((("ratios",), [3, 1]), "ratios is [3,1]; want the smaller ratio first"),
        "no colour": ((("inputs",), content["inputs"][1:]), "want a list with color"),
        "an invalid input": ((("inputs", 0, "name"), "length"), "inputs[0].name is"),
        "no requirements": ((("requires",), GONE), "requires is undefined"),
        "invalid limits": ((("requires", "limits"), ["x"]), "requires.limits is"),
    }  # fmt: skip


def test_malicious_shader_descriptions_are_refused_by_field(tmp_path: Path) -> None:
    write_shader_folder("classifier", tmp_path / "shaders")
    content = json.loads((tmp_path / "shaders" / "upscaler.json").read_text())
    edits = shader_edits(content)
    cases = [{"upscaler.json": edited(content, *edit)} for edit, _ in edits.values()]
    said = answers("shaders", tmp_path / "shaders", cases, tmp_path)
    assert others_than(said, {name: text for name, (_, text) in edits.items()}) == {}
    assert all(text.startswith("UpscalerError: ") for text in said)


@pytest.mark.parametrize("method", WITH_SHADERS)
def test_exported_shaders_are_read(method: str, tmp_path: Path) -> None:
    write_shader_folder(method, tmp_path / "shaders")
    assert answers("shaders", tmp_path / "shaders", [{}], tmp_path) == ["read"]


def test_shaders_that_blend_aovs_are_refused(tmp_path: Path) -> None:
    write_shader_folder("taa", tmp_path / "shaders", aovs=4)
    [said] = answers("shaders", tmp_path / "shaders", [{}], tmp_path)
    assert said.startswith("UpscalerError: ")


def test_readers_keep_their_promises_about_servers_folders_and_sizes() -> None:
    found = json.loads(ran(NODE, CHECKS))
    assert len(found) >= 15
    assert {promise: answer for promise, answer in found.items() if answer is not True} == {}


def test_texts_reach_the_page_as_text() -> None:
    sources = [
        path for path in (TESTS.parent / "examples" / "web").rglob("*") if path.suffix in {".js", ".html"}
    ]
    assert len(sources) > 25
    markup = re.compile(r"(inner|outer|insertAdjacent)HTML|document\.write|eval\(|new Function|srcdoc")
    assert [path.name for path in sources if markup.search(path.read_text("utf-8"))] == []
