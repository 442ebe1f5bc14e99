"""Render in several processes, each with an OpenGL context; one failure stops all."""

import multiprocessing
import os
import queue
import signal
import sys
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

from supersampler.errors import SupersamplerError
from supersampler_model.data.errors import DataError

OnFrame: TypeAlias = Callable[[], None]
Part: TypeAlias = Callable[[OnFrame], None]
"""Work of one process. It is pickled, and calls its argument after each frame."""

_POLL_SECONDS, _EXIT_SECONDS = 0.5, 10.0  # between checks for dead processes; for a process to exit


def run_parts(parts: Sequence[Part], *, on_frame: OnFrame = lambda: None) -> None:
    """Run each part in a process; software OpenGL uses cores / parts threads in each.

    `on_frame` is called in this process, after each frame.

    Raises:
        DataError: a part failed (a full disk, no OpenGL, a file that has changed) or its process ended.
    """
    context = multiprocessing.get_context("spawn")  # a forked OpenGL context is undefined
    results = context.Queue()
    threads = max((os.cpu_count() or 1) // max(len(parts), 1), 1)
    processes = [context.Process(target=_work, args=(part, results, threads), daemon=True) for part in parts]
    try:
        for process in processes:
            process.start()
        _report(processes, results, on_frame)
    finally:
        started = [process for process in processes if process.pid is not None]
        for process in started:
            process.terminate()
        for process in started:
            process.join(_EXIT_SECONDS)
            if process.is_alive():
                process.kill()
                process.join(_EXIT_SECONDS)


def _report(processes: list[Any], results: Any, on_frame: OnFrame) -> None:
    """Report frames until all processes are done."""
    running = len(processes)
    while running:
        try:
            kind, text = results.get(timeout=_POLL_SECONDS)
        except queue.Empty:
            dead = [p for p in processes if p.exitcode not in (None, 0)]
            if dead:
                raise DataError(f"a worker ended with code {dead[0].exitcode}; run again to resume") from None
            continue
        if kind == "failed":
            raise DataError(text)
        if kind == "frame":
            on_frame()
        else:
            running -= 1


def _work(part: Part, results: Any, threads: int) -> None:
    """Do one part in this process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the parent handles it
    os.environ.setdefault("LP_NUM_THREADS", str(threads))  # threads of software OpenGL

    def on_frame() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None and not parent.is_alive():  # an orphan must not disturb the next run
            sys.exit(1)
        results.put(("frame", ""))

    try:
        part(on_frame)
        results.put(("done", ""))
    except SupersamplerError as error:
        results.put(("failed", str(error)))
    except OSError as error:
        results.put(("failed", f"{error}; make room and run again"))
