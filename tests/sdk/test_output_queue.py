"""Tests of the queue that writes the images of a run."""

import threading
from functools import partial

import pytest

from supersampler.cli.results import OutputQueue

THREADS = 2
"""Limit of a queue on one core."""


def test_results_are_handed_on_in_the_order_of_put() -> None:
    first_may_end = threading.Event()
    taken: list[int] = []

    def first() -> int:
        assert first_may_end.wait(60)
        return 0

    with OutputQueue(taken.append) as queue:
        queue.put(first)
        queue.put(lambda: 1)
        first_may_end.set()
    assert taken == [0, 1]


def test_functions_that_wait_at_an_error_of_a_later_frame_still_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    threads_are_free = threading.Event()
    written: list[int] = []

    def write(number: int) -> None:
        assert threads_are_free.wait(60)
        written.append(number)

    def three_frames_and_an_error() -> None:
        with OutputQueue[None](lambda _: None) as queue:
            for number in range(THREADS + 1):
                queue.put(partial(write, number))
            raise RuntimeError("frame 3")

    timer = threading.Timer(0.2, threads_are_free.set)
    timer.start()
    with pytest.raises(RuntimeError, match="frame 3"):
        three_frames_and_an_error()
    timer.join()
    assert sorted(written) == [0, 1, 2]


def test_an_error_of_a_function_is_raised_by_the_queue() -> None:
    def full() -> None:
        raise OSError("no space left")

    with pytest.raises(OSError, match="no space left"), OutputQueue[None](lambda _: None) as queue:
        queue.put(full)
