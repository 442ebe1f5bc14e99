"""`register` and `methods`: the only list of methods.

The `spec.py` in each folder of this package registers the folder's methods when it is imported.
"""

from collections.abc import Iterable, Mapping
from importlib import import_module
from pkgutil import iter_modules
from typing import Any

import supersampler.methods
from supersampler.methods.spec import MethodSpec

_registered: dict[str, MethodSpec] = {}


def register(spec: MethodSpec) -> MethodSpec:
    """Add a method to the registry, and return it."""
    _registered[spec.name] = spec
    return spec


def methods() -> Mapping[str, MethodSpec]:
    """Return all methods by name, those without a network first."""
    for folder in _folders():
        import_module(f"supersampler.methods.{folder}.spec")
    return dict(sorted(_registered.items(), key=lambda item: (bool(item[1].task), item[0])))


def find_method(name: str) -> MethodSpec | None:
    """Return a method by name, or None. It imports no more specs than necessary."""
    stem = name.replace("-", "_")
    for folder in sorted(_folders(), key=lambda folder: not stem.startswith(folder)):
        if name not in _registered:
            import_module(f"supersampler.methods.{folder}.spec")
    return _registered.get(name)


def listed_methods(specs: Iterable[MethodSpec]) -> str:
    """Return the names, comma-separated; methods without released weights are marked."""
    return ", ".join(spec.name if spec.ships else f"{spec.name} (no weights ship)" for spec in specs)


def load(entry: str) -> Any:
    """Return the implementation that a spec names: "package.module:name"."""
    module, _, name = entry.partition(":")
    return getattr(import_module(module), name)


def _folders() -> list[str]:
    return [module.name for module in iter_modules(supersampler.methods.__path__) if module.ispkg]
