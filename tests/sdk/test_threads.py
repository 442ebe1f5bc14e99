"""Work is divided completely, among the available threads, at allowed places only."""

import gc
import threading
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from supersampler.backends.cpu.threads import Rect, RectTask, ThreadPool, split

boxes_in_rows = st.lists(
    st.tuples(st.integers(1, 40), st.integers(1, 60), st.integers(0, 9)), min_size=1, max_size=12
)


@given(boxes_in_rows, st.integers(1, 5), st.sampled_from([1, 2, 8]))
def test_shares_hold_every_row_once_and_begin_at_multiples(
    sizes: list[tuple[int, int, int]], count: int, multiple: int
) -> None:
    boxes, y = [], 0
    for height, width, x in sizes:
        boxes.append(Rect(y, y + height, x, x + width))
        y += height
    parts = split(boxes, count, multiple)
    assert 1 <= len(parts) <= count
    done = np.zeros((y, 80), int)
    for box in (box for part in parts for box in part):
        done[box.y0 : box.y1, box.x0 : box.x1] += 1
        (whole,) = [b for b in boxes if b.y0 <= box.y0 < b.y1]
        assert (box.y0 - whole.y0) % multiple == 0
    wanted = np.zeros_like(done)
    for box in boxes:
        wanted[box.y0 : box.y1, box.x0 : box.x1] += 1
    assert np.array_equal(done, wanted)


def test_a_single_box_is_cut_into_equal_bands() -> None:
    assert split([Rect(0, 540, 0, 960)], 2, 2) == [[Rect(0, 270, 0, 960)], [Rect(270, 540, 0, 960)]]


def test_the_times_of_stages_add_up_in_the_thread_that_calls() -> None:
    pool, rows = ThreadPool(2), []
    pool.run_rows("read", 10, lambda y0, y1, _: rows.append((y0, y1)))
    assert sorted(rows) == [(0, 5), (5, 10)]
    first = pool.stages.read
    pool.run_rows("read", 10, lambda *_: None)
    pool.run_rects("draw", [Rect(0, 4, 0, 4)], lambda *_: None)
    assert pool.stages.read > first > 0.0
    assert list(vars(pool.stages)) == ["read", "draw"]
    pool.close()


def test_jobs_are_done_together_each_in_shares_of_its_own() -> None:
    pool, rows = ThreadPool(2), []
    first = RectTask([Rect(0, 8, 0, 16)], lambda box, worker: rows.append(("first", box.y0, box.y1, worker)))
    second = RectTask([Rect(0, 3, 0, 1)], lambda box, worker: rows.append(("second", box.y0, box.y1, worker)))
    pool.run_tasks("gather", first, second)
    assert sorted(rows) == [("first", 0, 4, 0), ("first", 4, 8, 1), ("second", 0, 2, 0), ("second", 2, 3, 1)]
    pool.close()


@pytest.mark.parametrize("failing", [0, 1])
def test_an_error_in_a_thread_is_raised_after_all_finish_and_work_continues(failing: int) -> None:
    pool, begun, done = ThreadPool(2), [], []

    def work(y0: int, y1: int, worker: int) -> None:
        begun.append((y0, y1))
        time.sleep(0.01)
        if worker == failing:
            raise MemoryError("no room")
        time.sleep(0.02)
        done.append((y0, y1))

    with pytest.raises(MemoryError, match="no room"):
        pool.run_rows("read", 10, work)
    assert len(done) == len(begun) - 1
    time.sleep(0.05)
    assert len(done) == len(begun) - 1
    done.clear()
    pool.run_rows("read", 10, lambda y0, y1, _: done.append((y0, y1)))
    assert sorted(done) == [(0, 5), (5, 10)]
    pool.close()


def test_threads_end_with_what_they_help() -> None:
    before = set(threading.enumerate())
    pool = ThreadPool(3)
    assert set(threading.enumerate()) == before, "threads start with the first work"
    pool.run_rows("read", 12, lambda *_: time.sleep(0.01))
    pool.run_rows("read", 12, lambda *_: None)
    threads = {thread for thread in threading.enumerate() if thread.name == "supersampler"} - before
    assert len(threads) == 2
    del pool
    gc.collect()
    for thread in threads:
        thread.join(5.0)
        assert not thread.is_alive()


def test_stopped_bands_do_the_work_on_the_callers_thread() -> None:
    pool, done = ThreadPool(2), []
    pool.close()
    pool.run_rows("read", 10, lambda y0, y1, _: done.append((y0, y1, threading.get_ident())))
    assert sorted(rows[:2] for rows in done) == [(0, 5), (5, 10)]
    assert len({rows[2] for rows in done}) == 1


def test_bands_work_where_no_thread_can_be_started(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", refuse)
    pool, done = ThreadPool(3), []
    pool.run_rows("read", 9, lambda y0, y1, _: done.append((y0, y1)))
    assert sorted(done) == [(0, 3), (3, 6), (6, 9)]
