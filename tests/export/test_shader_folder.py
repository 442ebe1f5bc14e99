"""An exported folder of shaders holds everything a host needs; bad input gets a helpful error."""

import hashlib
import json
import re
from functools import cache
from importlib.resources import files
from math import prod
from operator import eq, ge
from pathlib import Path
from typing import Any

import pytest

from apart import run_apart
from supersampler.backends.gpu.memory import PixelBuffer
from supersampler.backends.gpu.program import ARRAYS, TEXTURES, GpuProgram
from supersampler.errors import ArgumentError, ModelError, ShotError
from supersampler.methods.aovs.gpu import aov_pass, aov_shader
from supersampler.methods.executors import gpu_program, with_shaders
from supersampler.methods.model_file import read_upscaling_info
from supersampler_export.shaders.folder import write_shader_folder
from upscale_runs import refusal, run, succeeded

METHODS = with_shaders()
PACKAGE = Path(str(files("supersampler")))
SHADERS = [PACKAGE / "backends/gpu/shaders", *sorted((PACKAGE / "methods").glob("*/shaders"))]


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The folder of each method, for textures; "taau buffers" for buffers; two that blend AOVs."""
    root = tmp_path_factory.mktemp("shaders")
    for method in METHODS:
        write_shader_folder(method, root / method)
    write_shader_folder("taau", root / "taau buffers", images="buffers")
    write_shader_folder("taau", root / "taau aovs", aovs=5)
    write_shader_folder("taau", root / "taau aovs buffers", images="buffers", aovs=5)
    return {folder.name: folder for folder in root.iterdir()}


def about(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "upscaler.json").read_text())
    return found


@cache
def program(method: str) -> GpuProgram:
    found = gpu_program(read_upscaling_info(method))
    assert found is not None
    return found


def size_of(rule: dict[str, Any], sizes: dict[str, tuple[int, int]]) -> tuple[int, int]:
    """A size as a host computes it."""
    width, height = sizes[rule["of"]]
    across, down = rule["multiply"]
    return -(-width // rule["divide"]) * across, -(-height // rule["divide"]) * down


def test_upscaler_json_is_as_its_schema_says(folders: dict[str, Path]) -> None:
    import jsonschema  # takes seconds

    schema = json.loads((files("supersampler_export.shaders") / "upscaler.schema.json").read_text())
    for folder in folders.values():
        jsonschema.validate(about(folder), schema)


@pytest.mark.parametrize("name", [*METHODS, "taau buffers", "taau aovs", "taau aovs buffers"])
def test_every_resource_that_a_shader_declares_is_described(folders: dict[str, Path], name: str) -> None:
    described = about(folders[name])
    resources = {one["name"]: one for one in described["resources"]}
    bound = set()
    for one in described["passes"]:
        code = (folders[name] / one["file"]).read_text()
        declared = {(int(g), int(b)) for g, b in re.findall(r"@group\((\d+)\) @binding\((\d+)\)", code)}
        assert {(b["group"], b["binding"]) for b in one["bindings"]} == declared, one["file"]
        for b in one["bindings"]:
            resource = resources[b["resource"]]
            assert b["kind"].endswith("texture") == (resource["kind"] == "texture"), b
            assert b.get("format", resource.get("format")) == resource.get("format"), b
            bound.add(b["resource"])
    assert bound == resources.keys()
    for before, after in described["history"]["pairs"]:
        assert resources[before]["role"] == "history"
        assert resources[after]["role"] == "next"
    assert {one["resource"] for one in described["inputs"]} == {
        name for name, one in resources.items() if one["role"] == "frame"
    }


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("render", "display"), [((37, 21), (101, 61)), ((1, 1), (1, 2)), ((320, 180), (641, 363))]
)
def test_sizes_by_rule_are_those_of_the_gpu_backend_and_of_the_larger_display_at_least_as_large(
    folders: dict[str, Path], method: str, render: tuple[int, int], display: tuple[int, int]
) -> None:
    across, down = (-(-extent // 4) for extent in render)
    phases = 9 * display[0] * display[1] // (render[0] * render[1]) + 2
    signatures = across, down * phases
    sizes = {"one": (1, 1), "render": render, "previous": render, "display": display}
    sizes |= {"signatures": signatures, "previous_signatures": signatures}
    memory, exact = program(method).memory(), method != "classifier-large"
    described = about(folders[method])
    held = [one for one in described["resources"] if one["role"] in ("history", "next", "work", "aux")]
    assert len(held) >= 6
    for one in held:
        size, want = size_of(one["size"], sizes), memory[one["name"]]
        suits = eq if exact or one["size"]["of"] != "display" else ge
        if isinstance(want, PixelBuffer):
            assert suits(one["bytes"] * prod(size), want.total_bytes(render, display)), one
        else:
            assert all(map(suits, size, want.extent.size(render, display))), one
            assert one["format"] == want.format, one
    for entry, of_pass in zip(described["passes"], program(method).passes, strict=True):
        suits = eq if of_pass.extent.of != "large" else ge
        assert all(map(suits, size_of(entry["covers"], sizes), of_pass.extent.size(render, display)))


@pytest.mark.parametrize(("name", "variants"), [("classifier", TEXTURES), ("taau buffers", ARRAYS)])
def test_files_are_the_shaders_that_the_gpu_backend_runs(
    folders: dict[str, Path], name: str, variants: dict[str, str]
) -> None:
    method, described = name.split()[0], about(folders[name])
    for one, spec in zip(described["passes"], program(method).passes, strict=True):
        assert (folders[name] / one["file"]).read_text() == program(method).shader(spec, variants).code
    digests = {
        file.name: hashlib.sha256(file.read_bytes()).hexdigest()
        for file in folders[name].iterdir()
        if file.name != "upscaler.json"
    }
    assert described["files"] == digests
    for weights, words in program(method).weights.items():
        assert (folders[name] / f"{weights}.bin").read_bytes() == words.tobytes()


def test_fields_of_params_are_those_of_the_shaders(folders: dict[str, Path]) -> None:
    text = (SHADERS[0] / "params.wgsl").read_text()
    declared = re.findall(r"^    (\w+): (vec2f|f32),", text, re.MULTILINE)
    params = about(folders["taau"])["params"]
    assert [(f["name"], {1: "f32", 2: "vec2f"}[f["count"]]) for f in params["fields"]] == declared
    ends = [f["offset"] + 4 * f["count"] for f in params["fields"]]
    assert [f["offset"] for f in params["fields"]] == [0, *ends[:-1]]
    assert params["bytes"] >= ends[-1]
    assert params["bytes"] % 16 == 0


def test_frames_and_images_are_in_buffers_where_that_is_asked_for(folders: dict[str, Path]) -> None:
    described = about(folders["taau buffers"])
    given = {r["name"]: r for r in described["resources"] if r["role"] in ("frame", "image")}
    assert {name: (r["kind"], r["bytes"], r["size"]["of"]) for name, r in given.items()} == {
        "frame_color": ("buffer", 12, "render"),
        "frame_depth": ("buffer", 4, "render"),
        "frame_motion": ("buffer", 8, "render"),
        "frame_reactive": ("buffer", 4, "render"),
        "image": ("buffer", 12, "display"),
    }
    assert {one["formats"][0] for one in described["inputs"]} == {"float32"}


def test_textures_of_aovs_hold_four_channels_each_and_a_buffer_all(folders: dict[str, Path]) -> None:
    for name, channels, targets, last in (
        ("taau aovs", [4, 4], ["aovs0", "aovs1"], aov_pass(2, 1, in_texture=True, has_history=True)),
        ("taau aovs buffers", [5], ["next_aovs"], aov_pass(5, 0, in_texture=False, has_history=True)),
    ):
        described = about(folders[name])
        shader = aov_shader(last, ARRAYS if "buffers" in name else TEXTURES)
        assert (folders[name] / described["passes"][-1]["file"]).read_text() == shader.code
        aovs = [one for one in described["inputs"] if one["name"].startswith("aovs")]
        assert [one["channels"] for one in aovs] == channels
        assert described["aovs"]["resources"] == targets
    assert "aovs" not in about(folders["taau"])


def mixed_operators(code: str) -> list[str]:
    """Return the operators that stand beside a bitwise one without brackets, which WGSL forbids."""
    code, levels, found = re.sub(r"//.*", "", code), [set[str]()], []
    for token in re.findall(r"&&|\|\||[=!<>]=| (?:<<|>>|[&|^+*/%<>-]) |[()\[\]{},;=]", code):
        operator = token.strip()
        if operator in "([{":
            levels.append(set())
        elif operator in ")]}":
            levels.pop()
        elif operator in ("<<", ">>", *"&|^+*/%-"):
            levels[-1].add(operator)
            if len(levels[-1]) > 1 and levels[-1] & {"<<", ">>", *"&|^"}:
                found.append(" ".join(sorted(levels[-1])))
        else:
            levels[-1].clear()
    return found


def test_bitwise_operators_are_bracketed_as_every_compiler_of_wgsl_asks() -> None:
    assert mixed_operators("let a = b & c | d;") == ["& |"]
    assert mixed_operators("let a = f(b << 16u | c, d >> 1u);") == ["<< |"]
    assert mixed_operators("let a = (b & c) | (d << 2u); let e = x + y * z;") == []
    for path in (path for folder in SHADERS for path in sorted(folder.glob("*.wgsl"))):
        assert mixed_operators(path.read_text()) == [], path


def test_a_second_export_replaces_the_files_of_the_first(tmp_path: Path) -> None:
    write_shader_folder("classifier", tmp_path)
    write_shader_folder("taa", tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {*about(tmp_path)["files"], "upscaler.json"}
    assert not (tmp_path / "network0.bin").exists()


def test_foreign_files_are_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "00_measure.wgsl").write_text("mine")
    with pytest.raises(ShotError, match="already exists"):
        write_shader_folder("taa", tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["00_measure.wgsl"]


def test_a_method_without_shaders_is_refused_with_those_that_have_them(tmp_path: Path) -> None:
    with pytest.raises(
        ArgumentError, match=r"'gbuffer-small'; want .*taa, taau, classifier, classifier-large"
    ):
        write_shader_folder("gbuffer-small", tmp_path / "out")
    with pytest.raises(ModelError, match="Did you mean 'classifier'"):
        write_shader_folder("classifer", tmp_path / "out")
    assert not (tmp_path / "out").exists()


PROGRAM = """
import os, sys
for name in ("torch", "onnx", "wgpu", "supersampler_model"):
    sys.modules[name] = None
from supersampler.cli.app import main
sys.argv[1:] = ["export", "classifier", "--target", "wgsl", "-o", os.environ["OUT"]]
main()
"""


def test_the_command_needs_neither_torch_nor_wgpu(tmp_path: Path) -> None:
    run_apart(PROGRAM, OUT=str(tmp_path))
    assert about(tmp_path)["method"] == "classifier"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--target", "wgsl", "--weights", "w.safetensors"], "none with --target"),
        (["--images", "buffers"], "none without --target wgsl"),
        (["--images", "buffers", "--target", "npm"], "none without --target wgsl"),
        (["--aovs", "4"], "none without --target wgsl"),
        (["--aovs", "4", "--target", "npm"], "none without --target wgsl"),
    ],
)
def test_options_that_do_not_go_together_are_refused(
    tmp_path: Path, options: list[str], message: str
) -> None:
    assert message in refusal("export", "taau", "-o", tmp_path / "out", *options)


def test_all_writes_every_shipped_model_that_has_shaders(tmp_path: Path) -> None:
    succeeded(run("export", "all", "--target", "wgsl", "-o", tmp_path))
    assert {folder.name for folder in tmp_path.iterdir()} == {*METHODS}
    assert all(about(tmp_path / method)["method"] == method for method in METHODS)
