"""Everybody else's numba functions work before, between and after steps."""

from pathlib import Path

from apart import STEP, cache_without_a_kernel, run_apart

FOREIGN = """
import numba
@numba.njit
def plain(a, b):
    return a + b
@numba.njit(parallel=True)
def parallel(values):
    total = 0.0
    for i in numba.prange(values.size):
        total += values[i]
    return total
@numba.njit
def raising(n):
    if n < 0:
        raise ValueError("negative")
    return n
@numba.njit
def allocating(n):
    parts = [np.ones(i + 1) for i in range(n)]
    return sum([part.sum() for part in parts])
@numba.cfunc(numba.types.float64(numba.types.float64))
def callback(x):
    return 2.0 * x
@numba.njit
def texts(n):
    return "n = " + str(n)
def use():
    assert plain(1, 2) == 3 and plain(1.5, 2) == 3.5
    assert parallel(np.ones(1000)) == 1000.0
    assert allocating(10) == 55.0 and callback.ctypes(2.0) == 4.0 and texts(3) == "n = 3"
    try:
        raising(-1)
    except ValueError as error:
        assert str(error) == "negative"
    else:
        raise AssertionError("nothing raised")
"""


def test_functions_compiled_before_between_and_after_steps_work() -> None:
    run_apart(f"""{STEP}{FOREIGN}
plain(1, 2)
one = upscaler()
first = one.step(noise(0))
use()
second = one.step(noise(1))
use()
other = upscaler("taau")
other.step(noise(0))
plain(np.int8(1), np.int8(2))  # compiled now
again = upscaler()
assert np.array_equal(again.step(noise(0)), first) and np.array_equal(again.step(noise(1)), second)
""")


def test_functions_work_when_a_kernel_is_compiled_in_their_process(tmp_path: Path) -> None:
    run_apart(
        f"""{STEP}{FOREIGN}
import sys
plain(1, 2)
sys.executable = None
image = upscaler("taa").step(noise(0))
assert "supersampler.backends.cpu.kernel_compiler" in sys.modules
use()
""",
        XDG_CACHE_HOME=cache_without_a_kernel(tmp_path),
    )
