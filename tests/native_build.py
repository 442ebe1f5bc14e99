"""The modules beside the sources of the CPU library, which are in no package."""

import importlib.util
from pathlib import Path
from types import ModuleType

SOURCES = Path(__file__).parents[1] / "sdk" / "native"


def native_build() -> ModuleType:
    return _module("build")


def native_generated() -> ModuleType:
    return _module("generate")


def _module(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"native_{name}", SOURCES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
