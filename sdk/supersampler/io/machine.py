"""Description of the machine, and versions of installed packages."""

import os
import platform
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
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


def installed_versions(*packages: str) -> dict[str, str]:
    """Return the versions of the packages that are installed, by name."""
    found = {}
    for name in packages:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


@dataclass
class StageTime:
    """Times of one stage.

    Attributes:
        calls: number of times that it ran.
        wall: seconds that have passed in it.
        cpu: seconds of CPU time of the threads that ran it; threads that they started are not included.
    """

    calls: int = 0
    wall: float = 0.0
    cpu: float = 0.0


@dataclass
class StageTimes:
    """Times by stage, in the order in which they first ran; any thread may measure."""

    stages: dict[str, StageTime] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        """Add the time of a block to a stage."""
        wall, cpu = time.perf_counter(), time.thread_time()
        try:
            yield
        finally:
            wall, cpu = time.perf_counter() - wall, time.thread_time() - cpu
            with self._lock:
                entry = self.stages.setdefault(stage, StageTime())
                entry.calls, entry.wall, entry.cpu = entry.calls + 1, entry.wall + wall, entry.cpu + cpu

    def to_json(self) -> dict[str, dict[str, float]]:
        """Return calls and seconds of each stage."""
        return {
            name: {key: round(value, 4) for key, value in asdict(stage).items()}
            for name, stage in self.stages.items()
        }
