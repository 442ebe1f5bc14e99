"""Imports point one way: supersampler <- supersampler_model <- supersampler_export <- supersampler_bench."""

import ast
import importlib.util
import sys
from collections.abc import Sequence
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from apart import run_apart

ROOT = Path(__file__).parents[1]
PACKAGES = {
    "supersampler": "sdk",
    "supersampler_model": "model",
    "supersampler_export": "export",
    "supersampler_bench": "bench",
}
FLOORS = (  # of the SDK, the lowest first: a module imports from its own floor and those below it
    ("errors", "arguments"),
    ("frame",),
    ("io.files", "io.child_process", "backends.base", "backends.cpu.library"),  # which conventions call, too
    ("conventions",),
    ("io",),
    ("methods", "backends"),
    ("history", "validation"),
    ("model",),
    ("extrapolation", "aux_outputs"),
    ("upscaler", "recording"),
    ("sequence", "denoising"),
    ("integrations",),
    ("cli",),
)
PROGRAMS = {"bpy", "render_frames", "vtkmodules"}  # only integrations import them; the second: in Blender
RUNTIME = {"numpy", "onnxruntime", "OpenImageIO", "msgspec", "typer", "rich"}  # a runtime install
OPTIONAL = {"wgpu", "pyoidn"}  # an extra: imported where it is used


@cache
def imports(file: Path) -> Sequence[tuple[int, str, bool]]:
    """Return (line, module, for type checkers alone) of each import statement, those inside functions too.

    Of `from a import b` it is a.b: b may be a module.
    """
    nodes = tuple(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
    guards = [n for n in nodes if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING"]
    for_types = {id(inner) for guard in guards for inner in ast.walk(guard)}
    return [
        (
            node.lineno,
            f"{node.module}.{alias.name}" if isinstance(node, ast.ImportFrom) else alias.name,
            id(node) in for_types,
        )
        for node in nodes
        if isinstance(node, (ast.Import, ast.ImportFrom)) and not getattr(node, "level", 0)
        for alias in node.names
    ]


def imports_outside(package: str, allowed: set[str]) -> list[str]:
    files = sorted((ROOT / PACKAGES[package] / package).rglob("*.py"))
    assert files, f"no sources of {package}"
    tops = [(file, line, name.partition(".")[0]) for file in files for line, name, _ in imports(file)]
    return [
        f"{file.relative_to(ROOT)}:{line} imports {top}" for file, line, top in tops if top not in allowed
    ]


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_imports_only_those_below_it(package: str) -> None:
    names = list(PACKAGES)
    above = set(names[names.index(package) + 1 :])
    files = ROOT.glob("*/supersampler*/**/*.py")
    everything = {name.partition(".")[0] for file in files for _, name, _ in imports(file)}
    assert imports_outside(package, everything - above) == []


def floor_of(module: str) -> int:
    """Floor of a module of the SDK, by the longest name among FLOORS that it is or lies in."""
    path = f"{module.removeprefix('supersampler.')}."
    named = [(len(n), floor) for floor, names in enumerate(FLOORS) for n in names if path.startswith(f"{n}.")]
    assert named, f"{module} is on no floor"
    return max(named)[1]


def test_inside_the_sdk_imports_point_down() -> None:
    modules = modules_of("supersampler")
    upwards = [
        f"{file.relative_to(ROOT)}:{line} imports {name}"
        for module, file in modules.items()
        if module not in ("supersampler", "supersampler.__main__")
        for line, name, for_types in imports(file)
        if name.startswith("supersampler.") and name != "supersampler.__version__" and not for_types
        if floor_of(name) > floor_of(module)
    ]
    assert upwards == []


def modules_of(package: str, root: Path | None = None) -> dict[str, Path]:
    top = root or ROOT / PACKAGES[package]
    files = (top / package).rglob("*.py")
    return {".".join(f.relative_to(top).with_suffix("").parts).removesuffix(".__init__"): f for f in files}


def graph_of(modules: dict[str, Path]) -> dict[str, set[str]]:
    """Return the modules of a package that each one imports, also for type checkers only."""
    return {
        module: {name if name in modules else name.rpartition(".")[0] for _, name, _ in imports(file)}
        & modules.keys()
        for module, file in modules.items()
    }


@pytest.mark.parametrize("package", PACKAGES)
def test_no_modules_import_each_other_in_a_circle_not_even_for_types(package: str) -> None:
    graph = graph_of(modules_of(package))
    tuple(TopologicalSorter(graph).static_order())  # raises CycleError, which names the modules


def test_a_circle_for_types_alone_is_found(tmp_path: Path) -> None:
    (tmp_path / "pack").mkdir()
    (tmp_path / "pack" / "a.py").write_text("from pack.b import f\n")
    (tmp_path / "pack" / "b.py").write_text("if TYPE_CHECKING:\n    from pack.a import T\n")
    with pytest.raises(CycleError):
        tuple(TopologicalSorter(graph_of(modules_of("pack", tmp_path))).static_order())


@pytest.mark.parametrize("script", ["render_frames", "composite_frames"])
def test_scripts_inside_blender_do_not_import_the_package(script: str) -> None:
    file = ROOT / "sdk" / "supersampler" / "integrations" / "blender" / f"{script}.py"
    names = {name.partition(".")[0] for _, name, _ in imports(file)}
    assert names - set(sys.stdlib_module_names) - {"render_frames"} == {"bpy"}


def test_few_modules_lie_at_the_root_of_the_sdk() -> None:
    modules = {file.stem for file in (ROOT / "sdk" / "supersampler").glob("*.py")} - {"__init__", "__main__"}
    assert len(modules) <= 12, sorted(modules)


def test_the_sdk_imports_its_runtime_dependencies_and_nothing_else() -> None:
    allowed = RUNTIME | OPTIONAL | {"supersampler"} | set(sys.stdlib_module_names)
    found = imports_outside("supersampler", allowed)
    doors = [line for line in found if line.startswith("sdk/supersampler/integrations/")]
    assert {line.rpartition(" ")[2] for line in doors} <= PROGRAMS
    videos = [line for line in found if line.startswith("sdk/supersampler/io/video.py")]
    assert {line.rpartition(" ")[2] for line in videos} == {"av"}  # the extra `video`
    assert sorted({*found} - {*doors, *videos}) == []


@pytest.mark.skipif(importlib.util.find_spec("torch") is None, reason="torch is not installed here")
def test_importing_the_sdk_loads_no_torch_even_where_it_is_installed() -> None:
    program = "import sys, supersampler; print({'torch', 'onnx', 'supersampler_model'} & sys.modules.keys())"
    assert run_apart(program).stdout.strip() == "set()"
