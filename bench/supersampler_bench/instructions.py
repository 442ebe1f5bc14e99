"""Kernels compiled as for a processor with fewer instructions than this one."""

import os
import platform
from typing import Literal

from supersampler.errors import ArgumentError

_FEATURES = (
    "sse", "sse2", "sse3", "ssse3", "sse4.1", "sse4.2", "popcnt", "avx", "avx2", "fma", "f16c", "bmi", "bmi2",
    "lzcnt", "movbe",
)  # fmt: skip
_PROCESSORS = {  # LLVM's names for the first that had them, of 2013 and 2021
    "avx2": ("haswell", _FEATURES),
    "avx-vnni": ("alderlake", (*_FEATURES, "avxvnni")),
}


def compile_for(instructions: Literal["avx2", "avx-vnni"]) -> None:
    """Have this process compile what it loads from now on for such a processor, and keep it apart.

    Raises:
        ArgumentError: this one is of another kind.
    """
    if platform.machine().lower() not in ("x86_64", "amd64"):
        hint = "They are of x86-64 processors."
        raise ArgumentError("--instructions", got=instructions, want="all", hint=hint)
    name, features = _PROCESSORS[instructions]
    listed = ",".join(f"+{feature}" for feature in features)
    os.environ.update(NUMBA_CPU_NAME=name, NUMBA_CPU_FEATURES=listed)
