"""Kernels compiled as for a processor with fewer instructions than this one."""

import os
import platform

from supersampler.errors import ArgumentError

_NAME = "haswell"  # of 2013, the first with AVX2; what desktops have had since, but for AVX-512
_FEATURES = (
    "sse", "sse2", "sse3", "ssse3", "sse4.1", "sse4.2", "popcnt", "avx", "avx2", "fma", "f16c", "bmi", "bmi2",
    "lzcnt", "movbe",
)  # fmt: skip


def compile_for_avx2() -> None:
    """Have this process compile what it loads from now on for such a processor, and keep it apart.

    Raises:
        ArgumentError: this one is of another kind.
    """
    if platform.machine().lower() not in ("x86_64", "amd64"):
        raise ArgumentError("--instructions", got="avx2", want="all", hint="AVX2 is of x86-64 processors.")
    features = ",".join(f"+{name}" for name in _FEATURES)
    os.environ.update(NUMBA_CPU_NAME=_NAME, NUMBA_CPU_FEATURES=features)
