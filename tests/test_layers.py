"""Imports point one way: supersampler <- supersampler_model <- supersampler_export <- supersampler_bench."""

import ast
import importlib.util
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = {
    "supersampler": "sdk",
    "supersampler_model": "model",
    "supersampler_export": "export",
    "supersampler_bench": "bench",
}
RUNTIME = {"numpy", "onnxruntime", "OpenImageIO", "numba", "llvmlite", "typer", "rich"}  # a runtime install


def imported(file: Path) -> Iterator[tuple[int, str]]:
    """Yield (line, top-level package) of each import statement, those inside functions too."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
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


def test_the_sdk_imports_its_runtime_dependencies_and_nothing_else() -> None:
    assert imports_outside("supersampler", RUNTIME | {"supersampler"} | set(sys.stdlib_module_names)) == []


def test_the_checks_above_can_fail(tmp_path: Path) -> None:
    file = tmp_path / "module.py"
    file.write_text("def f():\n    import torch.nn\n    from supersampler_bench.cli import app\n")
    assert list(imported(file)) == [(2, "torch"), (3, "supersampler_bench")]


@pytest.mark.skipif(importlib.util.find_spec("torch") is None, reason="torch is not installed here")
def test_importing_the_sdk_loads_no_torch_even_where_it_is_installed() -> None:
    program = "import sys, supersampler; print({'torch', 'onnx', 'supersampler_model'} & sys.modules.keys())"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
