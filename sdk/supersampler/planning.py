"""`Upscaler.plan`: memory and arithmetic that a model needs at a size, before any is allocated."""

from collections.abc import Sequence
from pathlib import Path

from supersampler.arguments import checked_size
from supersampler.backends.plan import Plan
from supersampler.frame import Size
from supersampler.model import ExecutorName, Model, Precision


def plan(
    render_size: Size,
    display_size: Size,
    model: str | Path = "classifier",
    *,
    providers: str | Sequence[str] = "auto",
    threads: int = 0,
    executor: ExecutorName = "auto",
    precision: Precision = "auto",
) -> Plan:
    """Return the memory and the multiply-adds that an Upscaler needs per frame.

    >>> plan = Upscaler.plan((960, 540), (1920, 1080))  # render size, display size
    >>> megabytes = plan.history_bytes / 1e6

    Sizes are (width, height). See `Model.load` for the other arguments; a `Model` has its own `plan`.

    Raises:
        FrameError: the method does not support this ratio.
        ModelError, ProviderError, ArgumentError: see `Model.load`.
    """
    sizes = checked_size("render_size", render_size), checked_size("display_size", display_size)
    loaded = Model.load(model, providers=providers, threads=threads, executor=executor, precision=precision)
    return loaded.plan(*sizes)
