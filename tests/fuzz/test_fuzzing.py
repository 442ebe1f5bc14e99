"""The helper of all fuzz tests reports crashes, hangs, memory use and foreign errors."""

import os
import time
from collections.abc import Callable

import numpy as np

from fuzzing import HOSTILE, damaged, replaced, run_apart
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
    raised, killed, memory, hung = sorted(run_apart(_harmful, 7, memory=1 << 29, seconds=1.0))
    assert raised.startswith("case 2: KeyError: 'untyped'")
    assert killed.startswith("case 3: killed by SIGABRT")
    assert "MemoryError" in memory
    assert memory.startswith("case 4")
    assert hung.startswith("case 5: hung")


def test_damage_is_the_same_for_the_same_seed_and_reaches_every_depth() -> None:
    data = bytes(range(200))
    made = {damaged(data, np.random.default_rng(seed)) for seed in range(50)}
    assert made == {damaged(data, np.random.default_rng(seed)) for seed in range(50)}
    assert len(made) > 40
    value = {"a": [{"b": [1, 2, 3]}], "c": "d"}
    changed = [replaced(value, np.random.default_rng(seed)) for seed in range(300)]
    assert value == {"a": [{"b": [1, 2, 3]}], "c": "d"}
    assert any(other["a"][0]["b"][1] in HOSTILE[4:6] for other in changed if _whole(other))


def _whole(value: object) -> bool:
    try:
        return len(value["a"][0]["b"]) == 3  # type: ignore[index]
    except (TypeError, KeyError, IndexError):
        return False
