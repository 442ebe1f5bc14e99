"""Render a set with several processes, each with a context of its own, a sequence at a time."""

import multiprocessing
import os
import queue
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from supersampler.errors import SupersamplerError
from supersampler.image_io import remove_partial_files
from supersampler_model.data.dataset.description import Dataset, open_dataset
from supersampler_model.data.dataset.produce import render_sequence
from supersampler_model.data.errors import DataError
from supersampler_model.data.gl.renderer import Renderer

_WAIT = 0.5  # seconds between looks at whether a worker has died


def render_dataset(
    dataset: Dataset, *, workers: int = 1, on_frame: Callable[[], None] = lambda: None
) -> None:
    """Render all frames that are not there yet.

    Args:
        dataset: what to complete.
        workers: processes; software OpenGL draws with cores / workers threads in each.
        on_frame: called after each frame, in this process.

    Raises:
        DataError: a worker failed (a full disk, no OpenGL, a file that has changed); what is complete
            stays, and a next run goes on.
    """
    remove_partial_files(dataset.folder)
    todo = [i for i, e in enumerate(dataset.description.sequences) if dataset.complete(e) < e.spec.frames]
    if not todo:
        return
    context = multiprocessing.get_context("spawn")  # a forked OpenGL context is undefined
    results = context.Queue()
    with _threads_each(max((os.cpu_count() or 1) // workers, 1)):
        processes = [
            context.Process(target=_work, args=(dataset.folder, todo[k::workers], results), daemon=True)
            for k in range(min(workers, len(todo)))
        ]
        for process in processes:
            process.start()
    try:
        _follow(processes, results, on_frame)
    finally:
        for process in processes:
            process.terminate()
            process.join()


def _follow(processes: list[Any], results: Any, on_frame: Callable[[], None]) -> None:
    """Count frames until every worker has said that it is done."""
    running = len(processes)
    while running:
        try:
            kind, text = results.get(timeout=_WAIT)
        except queue.Empty:
            dead = [p for p in processes if p.exitcode not in (None, 0)]
            if dead:
                raise DataError(f"a worker ended with code {dead[0].exitcode}; run again to go on") from None
            continue
        if kind == "failed":
            raise DataError(text)
        if kind == "frame":
            on_frame()
        else:
            running -= 1


def _work(folder: Path, indices: list[int], results: Any) -> None:
    """Render some sequences in this process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all of them: the parent sees to it

    def on_frame() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None and not parent.is_alive():  # killed: a next run must not meet this one
            sys.exit(1)
        results.put(("frame", ""))

    try:
        dataset = open_dataset(folder)
        description = dataset.description
        renderer = Renderer(description.display_size, samples=description.samples)
        for index in indices:
            render_sequence(dataset, description.sequences[index], renderer, on_frame=on_frame)
        results.put(("done", ""))
    except SupersamplerError as error:
        results.put(("failed", str(error)))
    except OSError as error:
        results.put(("failed", f"{folder}: {error}; make room and run again"))


@contextmanager
def _threads_each(count: int) -> Iterator[None]:
    """Start children that draw with `count` threads, without changing the environment of this process."""
    before = os.environ.get("LP_NUM_THREADS")
    os.environ.setdefault("LP_NUM_THREADS", str(count))
    try:
        yield
    finally:
        if before is None:
            os.environ.pop("LP_NUM_THREADS", None)
