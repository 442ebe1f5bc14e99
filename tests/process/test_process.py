"""A process keeps its settings, ends cleanly, and works without optional packages."""

import os
import signal
from pathlib import Path

import pytest

from apart import STEP, run_apart

MODELS = """
from pathlib import Path
from supersampler import Model
def maps():
    return len(Path("/proc/self/maps").read_text().splitlines())
def threads():
    return len(list(Path("/proc/self/task").iterdir()))
"""


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="needs /proc, to count memory maps")
@pytest.mark.parametrize(
    ("executor", "count"), [("cpu", int(os.environ.get("SUPERSAMPLER_MODELS", "300"))), ("onnx", 20)]
)
def test_models_made_and_dropped_leave_no_memory_maps_and_no_threads(executor: str, count: int) -> None:
    """Without the garbage collector, which programs of real time switch off."""
    run_apart(
        f"""{STEP}{MODELS}
import gc
gc.disable()
def make(count):
    for index in range(count):
        upscaler(("taa", "classifier")[index % 2], executor="{executor}").step(noise(0))
make(4)
before = maps(), threads()
make({count})
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


def test_a_process_ends_while_threads_load_graphs() -> None:
    run_apart("""
import threading, time
from supersampler import Model
begun = threading.Barrier(4)
def load():
    begun.wait()
    while True:
        Model.load("classifier", executor="onnx")
for _ in range(3):
    threading.Thread(target=load, daemon=True).start()
Model.load("taa", executor="onnx")
begun.wait()
time.sleep(0.1)
""")


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
def test_an_exit_handler_steps(executor: str) -> None:
    """One that was registered before ONNX Runtime was imported runs after the wait for daemon threads."""
    done = run_apart(
        f"""
import atexit
atexit.register(lambda: print(u.step(noise(1)).shape)){STEP}
u = upscaler("taau", executor="{executor}")
u.step(noise(0))
""",
        seconds=60,
    )
    assert done.stdout.strip() == "(36, 64, 3)"


@pytest.mark.skipif(not hasattr(signal, "sigwait"), reason="this system cannot block signals")
def test_signals_that_a_program_blocks_wait_for_it() -> None:
    """A worker thread that does not block them would take SIGTERM, which ends the process."""
    run_apart(
        f"""{STEP}
import os, signal
u = upscaler("taau")
u.step(noise(0))
signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM])
os.kill(os.getpid(), signal.SIGTERM)
assert signal.sigwait([signal.SIGTERM]) == signal.SIGTERM
""",
        OPENBLAS_NUM_THREADS="1",
    )


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="this system does not list threads")
def test_threads_do_not_block_signals_of_faults_and_sandboxes() -> None:
    run_apart(f"""{STEP}
import signal, time
from pathlib import Path
def masks():
    status = [(task / "status").read_text().splitlines() for task in Path("/proc/self/task").iterdir()]
    return [int(line.split()[1], 16) for lines in status for line in lines if line.startswith("SigBlk")]
def blocking(number):
    return sum(mask >> number - 1 & 1 for mask in masks())
u = upscaler("taau", executor="cpu", threads=4)
u.step(noise(0))
assert blocking(signal.SIGTERM) >= 3, masks()
faults = "SIGSEGV", "SIGBUS", "SIGFPE", "SIGILL", "SIGTRAP", "SIGABRT", "SIGSYS"
for number in (getattr(signal, name) for name in faults):
    end = time.monotonic() + 30
    while blocking(number) and time.monotonic() < end:
        time.sleep(0.01)  # a thread that begins blocks all signals
    assert not blocking(number), (number, masks())
""")


def test_an_exit_raised_in_a_step_ends_the_process() -> None:
    run_apart(f"""{STEP}
import atexit, signal, sys
def end(*_):
    signal.setitimer(signal.ITIMER_REAL, 10.0)  # again, as Python ignores an exit raised in a `__del__`
    sys.exit(0)
signal.signal(signal.SIGALRM, end)
atexit.register(signal.setitimer, signal.ITIMER_REAL, 0.0)  # else it would end a process that ends slowly
u = upscaler("taau", display_size=(640, 360))
frame = noise(1, (320, 180))
signal.setitimer(signal.ITIMER_REAL, 0.1)
while True:
    u.step(frame)
""")


WARNED = """
import warnings
from pathlib import Path
from supersampler.backends.cpu import library
library._PATH = Path({path!r})
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    one, other = upscaler(), upscaler("taau")
    images = [one.step(noise(0)), other.step(noise(0))]
    extrapolating = upscaler("taau", extrapolation="guided-warp")
assert [w.category.__name__ for w in caught] == ["BackendWarning"], [str(w.message) for w in caught]
assert "several times slower" in str(caught[0].message), str(caught[0].message)
assert (one.model.executor, other.model.executor) == ("onnx", "onnx")
from supersampler.errors import LibraryError
try:
    upscaler(executor="cpu")
except LibraryError as error:
    print(error)
else:
    raise AssertionError("the CPU backend was asked for by name, and is not there")
"""


def test_without_the_library_the_graph_runs_and_one_warning_says_so(tmp_path: Path) -> None:
    done = run_apart(STEP + WARNED.format(path=str(tmp_path / "none.so")))
    assert "none.so is missing" in done.stdout
    assert "pip install" in done.stdout
