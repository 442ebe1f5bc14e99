"""A process keeps its settings, ends cleanly, and works without optional packages."""

import sys
from pathlib import Path

import pytest

from apart import STEP, cache_without_a_kernel, run_apart

MODELS = """
from pathlib import Path
from supersampler import Model
def maps():
    return len(Path("/proc/self/maps").read_text().splitlines())
def threads():
    return len(list(Path("/proc/self/task").iterdir()))
"""


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="needs /proc, to count memory maps")
def test_models_made_and_dropped_leave_no_memory_maps_and_no_threads() -> None:
    run_apart(
        f"""{STEP}{MODELS}
import gc, os, time
def make(count):
    for index in range(count):
        upscaler(("taa", "classifier")[index % 2]).step(noise(0))
    gc.collect()
    time.sleep(0.2)
make(20)
before = maps(), threads()
make(int(os.environ.get("SUPERSAMPLER_MODELS", "300")))
after = maps(), threads()
assert after[0] <= before[0] + 20 and after[1] <= before[1] + 4, (before, after)
""",
        seconds=600,
    )


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
def test_a_process_ends_while_threads_step(executor: str) -> None:
    run_apart(f"""{STEP}
import threading, time
begun = threading.Barrier(4)
def steps():
    u = upscaler("taau", display_size=(640, 360), executor="{executor}")
    u.step(noise(0, (320, 180)))
    begun.wait()
    while True:
        u.step(noise(0, (320, 180)))
for _ in range(3):
    threading.Thread(target=steps, daemon=True).start()
begun.wait()
time.sleep(0.05)
""")


def test_an_exit_raised_in_a_step_ends_the_process() -> None:
    run_apart(f"""{STEP}
import signal, sys
signal.signal(signal.SIGALRM, lambda *_: sys.exit(0))
u = upscaler("taau", display_size=(640, 360))
frame = noise(0, (320, 180))
signal.setitimer(signal.ITIMER_REAL, 0.1)
while True:
    u.step(frame)
""")


BLOCKED = """
import sys
for name in {names}:
    sys.modules[name] = None
"""
WARNED = """
import warnings
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    one, other = upscaler(), upscaler("taau")
    images = [one.step(noise(0)), other.step(noise(0))]
    extrapolating = upscaler("taau", extrapolation="guided-warp")
assert [w.category.__name__ for w in caught] == ["BackendWarning"], [str(w.message) for w in caught]
assert "several times slower" in str(caught[0].message), str(caught[0].message)
assert (one.model.executor, other.model.executor) == ("onnx", "onnx")
from supersampler.errors import KernelError
try:
    upscaler(executor="cpu")
except KernelError as error:
    print(error)
else:
    raise AssertionError("the CPU backend was asked for by name, and is not there")
"""


@pytest.mark.parametrize("missing", [["numba"], ["llvmlite", "llvmlite.binding", "numba"]])
def test_without_a_compiler_the_graph_runs_and_one_warning_says_so(
    tmp_path: Path, missing: list[str]
) -> None:
    done = run_apart(
        f"""{BLOCKED.format(names=missing)}
sys.executable = None  # whose processes would have them
{STEP}{WARNED}""",
        XDG_CACHE_HOME=str(tmp_path),
    )
    assert "numba" in done.stdout


def test_numba_switched_off_for_debugging_changes_nothing(tmp_path: Path) -> None:
    run_apart(
        f"{STEP}\nassert upscaler('taa').model.executor == 'cpu'",
        XDG_CACHE_HOME=cache_without_a_kernel(tmp_path),
        NUMBA_DISABLE_JIT="1",
        NUMBA_BOUNDSCHECK="1",
    )


@pytest.mark.parametrize("executable", ["None", "''", "'/nowhere/python3'", "'/bin/false'"])
def test_kernels_are_compiled_where_no_python_can_be_started(tmp_path: Path, executable: str) -> None:
    if sys.platform == "win32" and "false" in executable:
        pytest.skip("no such program")
    run_apart(
        f"""{STEP}
import sys
from supersampler.backends.cpu.kernel_loader import load_kernels
sys.executable = {executable}
load_kernels("backends.cpu.kernels.frame.measure")
""",
        XDG_CACHE_HOME=str(tmp_path),
    )


def test_neither_a_step_nor_a_compilation_changes_the_environment(tmp_path: Path) -> None:
    run_apart(
        f"""{STEP}
import os, signal, locale, threading
before = dict(os.environ), signal.getsignal(signal.SIGINT), os.getcwd(), locale.setlocale(locale.LC_ALL)
upscaler("taa").step(noise(0))
after = dict(os.environ), signal.getsignal(signal.SIGINT), os.getcwd(), locale.setlocale(locale.LC_ALL)
assert before == after
""",
        XDG_CACHE_HOME=cache_without_a_kernel(tmp_path),
    )


def test_a_module_in_the_working_directory_is_not_imported_by_a_compilation(tmp_path: Path) -> None:
    trap = tmp_path / "numba.py"
    trap.write_text(f"open({str(tmp_path / 'sprung')!r}, 'w').close()\n")
    run_apart(
        f"""{STEP}
import os
os.chdir({str(tmp_path)!r})
from supersampler.backends.cpu.kernel_loader import load_kernels
load_kernels("backends.cpu.kernels.frame.measure")
""",
        "-P",
        XDG_CACHE_HOME=str(tmp_path / "cache"),
    )
    assert not (tmp_path / "sprung").exists()
