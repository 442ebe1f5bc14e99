"""The helper of all fuzz tests reports crashes, hangs, memory use and foreign errors."""

import os
import time
from collections.abc import Callable

import numpy as np

from fuzzing import run_apart
from supersampler import ArgumentError


def _harmful() -> Callable[[int], object]:
    def run(case: int) -> object:
        match case:
            case 1:
                raise ArgumentError("x", got=1, want=2)
            case 2:
                raise KeyError("untyped")
            case 3:
                os.abort()
            case 4:
                return np.zeros(1 << 30, np.uint8)
            case 5:
                time.sleep(60)
        return None

    return run


def test_signals_hangs_memory_and_other_exceptions_are_findings_and_our_own_errors_are_none() -> None:
    raised, killed, memory, hung = sorted(run_apart(_harmful, 7, memory=1 << 29, seconds=5.0))
    assert raised.startswith("case 2: KeyError: 'untyped'")
    assert killed.startswith("case 3: killed by SIGABRT")
    assert "MemoryError" in memory
    assert memory.startswith("case 4")
    assert hung.startswith("case 5: hung")
