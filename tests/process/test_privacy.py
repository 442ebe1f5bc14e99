"""A runtime process opens no socket, and writes to its output folder alone."""

import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

STRACE = shutil.which("strace")
WRITING = [
    "open", "openat", "openat2", "creat", "mkdir", "mkdirat", "rename", "renameat", "renameat2", "unlink",
    "unlinkat", "rmdir", "link", "linkat", "symlink", "symlinkat", "truncate", "mknod", "mknodat",
]  # fmt: skip
LOCAL = ("AF_UNIX", "AF_NETLINK")  # stay on the machine

RUNTIME = """
import itertools, locale, os, signal
from pathlib import Path

def process():
    return signal.getsignal(signal.SIGINT), os.getcwd(), locale.setlocale(locale.LC_ALL)
before, environment = process(), dict(os.environ)
from supersampler import Shot, Upscaler
from supersampler.io.images import write_exr, write_png
from supersampler.io.display import display_transform, to_uint8

for name, executor in (("taa", "cpu"), ("bilinear", "onnx")):
    upscaler = Upscaler(name, scale=2, executor=executor)
    for item in itertools.islice(Shot.open("plaza"), 2):
        image = upscaler.step(item.frame)
    assert upscaler.model.executor == executor
    write_exr(Path(OUTPUT, name + ".exr"), image)
    write_png(Path(OUTPUT, name + ".png"), to_uint8(display_transform(image)))
changed = dict(os.environ).items() ^ environment.items()
assert {name for name, _ in changed} <= {"OpenImageIO_ROOT"}, "OpenImageIO sets that itself; nothing else"
assert process() == before
"""
TALKATIVE = """
import socket
from pathlib import Path

Path(OUTPUT, "here").touch()
Path(OUTPUT, "../there").touch()
socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
"""


@dataclass
class Traced:
    """Files that a process left in its home folder, and its system calls where strace is installed."""

    home: Path
    log: str

    def left(self) -> list[str]:
        return sorted({path.relative_to(self.home).parts[0] for path in self.home.rglob("*")})

    def sockets(self) -> list[str]:
        calls = re.findall(r"\bsocket\((\w+),", self.log)
        return [family for family in calls if family not in LOCAL]

    def written(self) -> set[Path]:
        """Folders other than the output in which something was made, changed or removed."""
        paths = set()
        for line in self.log.splitlines():
            call = re.match(r"\d+\s+(\w+)\(", line)
            if call is None or call[1] not in WRITING:
                continue
            if call[1].startswith("open") and not re.search("O_WRONLY|O_RDWR|O_CREAT", line):
                continue
            folder = re.search(r"\((?:AT_FDCWD|\d+)<(.*?)>, ", line)
            paths |= {Path(folder[1] if folder else "", text) for text in re.findall(r'"(.*?)"', line)}
        own = self.home / "output"
        outside = {path.resolve() for path in paths if not str(path).startswith("/dev/")}
        return {path.parent for path in outside if not path.is_relative_to(own)}


def run(code: str, home: Path) -> Traced:
    """Run a program as a user would, with nothing in the environment that keeps libraries quiet."""
    (home / "output").mkdir(parents=True)
    log = home.parent / "strace"
    calls = ",".join(f"?{name}" for name in ("%network", *WRITING))  # ?: some processors lack some
    watch = [] if STRACE is None else [STRACE, "-f", "-qq", "-y", "-s", "4096", "-e", calls, "-o", str(log)]
    environment = {
        "PATH": "/usr/bin:/bin",
        "HOME": str(home),
        "XDG_CACHE_HOME": str(home / "cache"),
        "PYTHONDONTWRITEBYTECODE": "1",  # in the folder that this package is developed in
    }
    program = f"OUTPUT = {str(home / 'output')!r}\n{code}"
    command = [*watch, sys.executable, "-c", program]
    done = subprocess.run(command, env=environment, cwd=home, capture_output=True, text=True, timeout=280)
    assert done.returncode == 0, done.stderr
    return Traced(home, log.read_text(errors="replace") if log.exists() else "")


@pytest.fixture(scope="module")
def traced(tmp_path_factory: pytest.TempPathFactory) -> Traced:
    return run(RUNTIME, tmp_path_factory.mktemp("runtime") / "home")


needs_strace = pytest.mark.skipif(
    STRACE is None, reason="strace, which sees what native code does, is not here"
)


def test_a_runtime_process_leaves_its_output_alone(traced: Traced) -> None:
    assert traced.left() == ["output"]


@needs_strace
def test_a_runtime_process_opens_no_socket(traced: Traced) -> None:
    assert traced.sockets() == []


@needs_strace
def test_a_runtime_process_writes_nowhere_else(traced: Traced) -> None:
    assert traced.written() == set()


@needs_strace
def test_the_guard_sees_a_socket_and_a_file_elsewhere(tmp_path: Path) -> None:
    home = tmp_path / "home"
    traced = run(TALKATIVE, home)
    assert traced.sockets() == ["AF_INET"]
    assert traced.written() == {home}
    assert traced.left() == ["output", "there"]


def test_one_module_alone_imports_onnxruntime() -> None:
    """Whoever imports it first decides whether its telemetry is on."""
    root = Path(__file__).parents[2]
    files = [file for folder in ("sdk", "model", "export", "bench") for file in (root / folder).rglob("*.py")]
    imports = re.compile(r"^\s*(import|from) onnxruntime\b", re.MULTILINE)
    found = [file.name for file in files if imports.search(file.read_text(encoding="utf-8"))]
    assert found == ["runtime.py"]
