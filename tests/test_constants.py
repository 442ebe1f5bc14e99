"""Algorithm constants are written once: torch, CPU kernels and shaders read them from the specs."""

import ast
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pytest

from supersampler.backends.gpu.shader import SHARED_CONSTANTS, numbers_of
from supersampler.methods.registry import methods
from supersampler.methods.spec import constants_of

ROOT = Path(__file__).parents[1]
SDK, NATIVE = ROOT / "sdk" / "supersampler", ROOT / "sdk" / "native" / "src"
MODEL = ROOT / "model" / "supersampler_model"
Sources = Mapping[str, str]
_COMMENT = re.compile(r"//[^\n]*")
_FLOAT = re.compile(r"(?<![\w.])(?:0x[0-9a-f.]+p[-+]?\d+|\d+\.\d*(?:e[-+]?\d+)?|\d+e[-+]?\d+)")


def texts(files: list[Path]) -> Sources:
    assert files
    return {str(file.relative_to(ROOT)): file.read_text(encoding="utf-8") for file in sorted(files)}


def spec_modules() -> list[str]:
    """Return the modules that define constants: the shared ones, and the spec of each method."""
    return [*SHARED_CONSTANTS, *sorted({spec.config.__module__ for spec in methods().values()})]


def defined(module: str) -> dict[str, float]:
    """Return the constants of a module by name."""
    return {
        f"{name}[{index}]" if isinstance(value, tuple) else name: part
        for name, value in numbers_of(module).items()
        for index, part in enumerate(np.ravel(value).tolist())
    }


def configured(module: str) -> dict[str, float]:
    """Return the constants in the configs of a module's methods by name."""
    specs = [spec for spec in methods().values() if spec.config.__module__ == module]
    values = {name: getattr(spec.config(), name) for spec in specs for name in constants_of(spec)}
    return {name: value for name, value in values.items() if value is not None}


def known_in(file: str, text: str) -> dict[str, float]:
    """Return the constants that a file must not repeat; of a method's file, not those of other methods."""
    parts, known = Path(file).parts, dict[str, float]()
    for module in spec_modules():
        owner = module.removesuffix(".spec").rpartition(".")[2]
        if owner in ("display", "constants", *parts) or module in text or "methods" not in parts:
            known |= defined(module)
        if owner in parts:
            known |= configured(module)
    return known


def implementations() -> dict[str, Sources]:
    """Return the sources that use constants: all but the modules that define them."""
    defining = {ROOT / "sdk" / f"{module.replace('.', '/')}.py" for module in spec_modules()}
    folders = ("backends/cpu", "backends/gpu", "methods")
    of_sdk = [file for folder in folders for file in (SDK / folder).rglob("*.py")]
    torch = [*(MODEL / "ops").rglob("*.py"), *(MODEL / "methods").rglob("*.py")]
    return {
        "shaders": texts([*SDK.rglob("*.wgsl")]),
        "kernels": texts([file for file in NATIVE.rglob("*.[ch]*") if file.name != "constants.h"]),
        "numpy": texts([file for file in of_sdk if file not in defining]),
        "torch": texts(torch),
    }


def shader_numbers(text: str) -> Iterator[float]:
    for literal in _FLOAT.findall(_COMMENT.sub("", text)):
        yield float.fromhex(literal) if literal.startswith("0x") else float(literal)


def python_numbers(text: str) -> Iterator[float]:
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Constant) and isinstance(node.value, float):
            yield node.value


def is_plain(value: float) -> bool:
    """Return whether a number is plain: a small fraction, a tenth or a power of ten."""
    small = abs(value) < 1000.0 and (value * 16.0 % 1.0 == 0.0 or round(value * 10.0, 9) % 1.0 == 0.0)
    return small or f"{abs(value):e}".partition("e")[0].strip("0") == "1."


def numbers(file: str, text: str) -> list[float]:
    found = python_numbers(text) if file.endswith(".py") else shader_numbers(text)
    return [value for value in found if not is_plain(value)]


def typed_again(sources: Sources) -> list[str]:
    """Return the literals that equal a constant of the specs."""
    found = []
    for file, text in sources.items():
        known = known_in(file, text)
        for value in numbers(file, text):
            same = [name for name, number in known.items() if np.float32(number) == np.float32(value)]
            found += [f"{file}: {value:g} is {' or '.join(same)}"] if same else []
    return found


@pytest.mark.parametrize("kind", ["shaders", "kernels", "numpy", "torch"])
def test_no_constant_of_a_spec_is_typed_again(kind: str) -> None:
    assert typed_again(implementations()[kind]) == []


def test_a_constant_that_is_typed_again_is_found() -> None:
    typed = {"a.wgsl": "// 0.501\nconst HALF = 0.501;\n", "b.py": "def f(x):\n    return x * 65504.0\n"}
    assert typed_again(typed) == ["a.wgsl: 0.501 is ROUNDING", "b.py: 65504 is MAX_HALF"]
    assert all(map(is_plain, (0.5, 1.0, 0.9, 1e-6, 1e-3, -1.0, 100.0, 0.0)))
    assert not any(map(is_plain, (0.501, 0.05, 0.999, 65504.0, 1024.0, 3e38, 0.2126)))
