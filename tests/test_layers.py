"""Imports point one way: supersampler <- supersampler_model <- supersampler_export <- supersampler_bench."""

import ast
import importlib.util
import subprocess
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from supersampler.backends.cpu.kernel_cache import SOURCES

ROOT = Path(__file__).parents[1]
PACKAGES = {
    "supersampler": "sdk",
    "supersampler_model": "model",
    "supersampler_export": "export",
    "supersampler_bench": "bench",
}
TOOL_CHAIN = ("memory", "structs", "kernel_cache", "kernel_compiler", "kernel_loader", "simd")
FLOORS = (  # of the SDK, the lowest first: a module imports from its own floor and those below it
    ("errors", "arguments"),
    ("frame",),
    # the tool chain of the kernels, which conventions run, too
    ("io.files", "io.child_process", "backends.base", *(f"backends.cpu.{name}" for name in TOOL_CHAIN)),
    ("conventions",),
    ("io",),
    ("methods", "backends"),
    ("history", "validation"),
    ("model",),
    ("extrapolation", "aux_outputs"),
    ("upscaler", "recording"),
    ("sequence",),
    ("integrations",),
    ("cli",),
)
PROGRAMS = {"bpy", "vtkmodules"}  # other people's: only integrations import them
RUNTIME = {
    "numpy",
    "onnxruntime",
    "OpenImageIO",
    "numba",
    "llvmlite",
    "msgspec",
    "typer",
    "rich",
}  # a runtime install
OPTIONAL = {"wgpu"}  # an extra: imported where it is used


@cache
def parsed(file: Path) -> Sequence[ast.AST]:
    """Return all nodes of a module."""
    return tuple(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))


def imported(file: Path) -> Iterator[tuple[int, str]]:
    """Yield (line, top-level package) of each import statement, those inside functions too."""
    for node in parsed(file):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name.split(".")[0]) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield node.lineno, str(node.module).split(".")[0]


def imports_outside(package: str, allowed: set[str]) -> list[str]:
    files = sorted((ROOT / PACKAGES[package] / package).rglob("*.py"))
    assert files, f"no sources of {package}"
    return [
        f"{file.relative_to(ROOT)}:{line} imports {name}"
        for file in files
        for line, name in imported(file)
        if name not in allowed
    ]


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_imports_only_those_below_it(package: str) -> None:
    names = list(PACKAGES)
    above = set(names[names.index(package) + 1 :])
    everything = {name for file in ROOT.glob("*/supersampler*/**/*.py") for _, name in imported(file)}
    assert imports_outside(package, everything - above) == []


def floor_of(module: str) -> int:
    """Floor of a module, by the longest name among FLOORS that it is or lies in."""
    named = [
        (len(n), floor)
        for floor, names in enumerate(FLOORS)
        for n in names
        if f"{module}.".startswith(f"{n}.")
    ]
    assert named, f"{module} is on no floor"
    return max(named)[1]


def modules_imported(file: Path, package: str = "supersampler") -> Iterator[tuple[int, str]]:
    """Yield (line, module of the package) of each import statement, but those for type checkers alone."""
    for_types = {
        id(inner)
        for node in parsed(file)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    for node in parsed(file):
        if isinstance(node, ast.ImportFrom) and id(node) not in for_types:
            module = str(node.module)
            if module.startswith(f"{package}."):
                yield node.lineno, module.removeprefix(f"{package}.")


def test_inside_the_sdk_imports_point_down() -> None:
    sdk = ROOT / "sdk" / "supersampler"
    upwards = []
    for file in sorted(sdk.rglob("*.py")):
        module = ".".join(file.relative_to(sdk).with_suffix("").parts).removesuffix(".__init__")
        if module in ("__init__", "__main__"):
            continue
        upwards += [
            f"{file.relative_to(ROOT)}:{line} imports {name}"
            for line, name in modules_imported(file)
            if floor_of(name) > floor_of(module)
        ]
    assert upwards == []


def imports_of(top: Path) -> dict[str, set[str]]:
    """Return which modules of a package each of them imports, for type checkers alone too."""
    names = {
        ".".join((top.name, *file.relative_to(top).with_suffix("").parts)).removesuffix(".__init__"): file
        for file in top.rglob("*.py")
    }
    found: dict[str, set[str]] = {}
    for module, file in names.items():
        nodes = parsed(file)
        wanted = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
        for node in nodes:
            if isinstance(node, ast.ImportFrom):
                of_it = (f"{node.module}.{alias.name}" for alias in node.names)
                wanted += [name if name in names else str(node.module) for name in of_it]
        found[module] = names.keys() & set(wanted)
    return found


@pytest.mark.parametrize("package", PACKAGES)
def test_no_modules_import_each_other_in_a_circle_not_even_for_types(package: str) -> None:
    imports = imports_of(ROOT / PACKAGES[package] / package)
    tuple(TopologicalSorter(imports).static_order())  # raises CycleError, which names the modules


def test_a_circle_for_types_alone_is_found(tmp_path: Path) -> None:
    (tmp_path / "pack").mkdir()
    (tmp_path / "pack" / "a.py").write_text("from pack.b import f\n")
    (tmp_path / "pack" / "b.py").write_text("if TYPE_CHECKING:\n    from pack.a import T\n")
    with pytest.raises(CycleError):
        tuple(TopologicalSorter(imports_of(tmp_path / "pack")).static_order())


def test_a_change_of_any_kernel_or_of_what_it_imports_leads_to_other_cached_kernels() -> None:
    sdk, simd = ROOT / "sdk" / "supersampler", "backends.cpu.simd"
    kernels = [
        file
        for file in sorted(sdk.rglob("*.py"))
        if file.name == "kernels.py"
        or file.parent.name == "kernels"
        or any(name.startswith(simd) for _, name in modules_imported(file))
    ]
    imported_by_kernels = {name for file in kernels for _, name in modules_imported(file)}
    assert "conventions.camera_motion" in imported_by_kernels
    modules = [file.relative_to(sdk).as_posix() for file in kernels]
    modules += [f"{name.replace('.', '/')}.py" for name in imported_by_kernels]
    folders = tuple(f"{source}/" for source in SOURCES)
    assert [module for module in modules if module not in SOURCES and not module.startswith(folders)] == []


def test_what_runs_inside_blender_imports_nothing_of_ours() -> None:
    file = ROOT / "sdk" / "supersampler" / "integrations" / "blender" / "render_frames.py"
    names = {name for _, name in imported(file)}
    assert names - set(sys.stdlib_module_names) == {"bpy"}


def test_operations_import_nothing_that_is_made_of_them() -> None:
    """Else which module is imported first decides whether the import works."""
    files = sorted((ROOT / "model" / "supersampler_model" / "ops").glob("*.py"))
    found = {name for file in files for _, name in modules_imported(file, "supersampler_model")}
    assert found
    assert {name for name in found if not name.startswith("ops.")} == set()


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


def test_the_checks_above_can_fail(tmp_path: Path) -> None:
    file = tmp_path / "module.py"
    file.write_text("def f():\n    import torch.nn\n    from supersampler_bench.cli import app\n")
    assert list(imported(file)) == [(2, "torch"), (3, "supersampler_bench")]


@pytest.mark.skipif(importlib.util.find_spec("torch") is None, reason="torch is not installed here")
def test_importing_the_sdk_loads_no_torch_even_where_it_is_installed() -> None:
    program = "import sys, supersampler; print({'torch', 'onnx', 'supersampler_model'} & sys.modules.keys())"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
