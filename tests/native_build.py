"""Modules by their files: those beside the sources of the CPU library, and others in no package."""

import importlib.util
from pathlib import Path
from types import ModuleType

SOURCES = Path(__file__).parents[1] / "sdk" / "native"


def native_build() -> ModuleType:
    """Return sdk/native/build.py."""
    return module_of(SOURCES / "build.py", "native_build")


def native_generated() -> ModuleType:
    """Return sdk/native/generate.py."""
    return module_of(SOURCES / "generate.py", "native_generate")


def module_of(file: Path, name: str = "") -> ModuleType:
    """Return the module in a file, under a name that differs from its own where packages have one like it."""
    spec = importlib.util.spec_from_file_location(name or file.stem, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
