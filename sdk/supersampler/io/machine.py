"""Description of the machine, and versions of installed packages."""

import os
import platform
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any


def machine() -> dict[str, Any]:
    """Return the CPU's model, its logical cores and the operating system."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text("utf-8", errors="replace").splitlines() if info.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    cpu = names[0] if names else platform.processor() or platform.machine()
    return {"cpu": cpu, "cores": os.cpu_count(), "os": platform.platform()}


def versions() -> dict[str, str]:
    """Return the versions of Python, this package, and the installed packages that images depend on."""
    packages = ("supersampler", "numpy", "onnxruntime", "onnxruntime-gpu", "onnxruntime-directml")
    return installed_versions(*packages) | {"Python": platform.python_version()}


def installed_versions(*packages: str) -> dict[str, str]:
    """Return the versions of the packages that are installed, by name."""
    found = {}
    for name in packages:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found
