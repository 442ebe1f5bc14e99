"""Arguments of `Upscaler` that are checked before anything is done with them."""

from collections.abc import Sequence
from pathlib import Path

from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.model import ExecutorName, Model, Precision, Skip


def checked_model(
    model: Model | str | Path,
    *,
    providers: str | Sequence[str],
    threads: int,
    executor: ExecutorName,
    precision: Precision,
    capture: bool,
) -> Model:
    """Return a model that is loaded, or load it; arguments as of `Model.load`.

    Raises:
        ArgumentError: it is loaded, and how it runs is given again.
        ModelError, ProviderError, ArgumentError: see `Model.load`.
    """
    if not isinstance(model, Model):
        return Model.load(
            model,
            providers=providers,
            threads=threads,
            executor=executor,
            precision=precision,
            capture=capture,
        )
    if threads or capture or (providers, executor, precision) != ("auto",) * 3:
        name = "providers, threads, executor, precision or capture"
        raise ArgumentError(name, got="set beside a Model", want="set in Model.load")
    return model


def checked_skip(skip: Skip) -> Skip:
    """Return what `skip` is.

    Raises:
        ArgumentError: neither a word that is known nor a number in [0, 1].
    """
    if skip in ("auto", "exact") or (isinstance(skip, (int, float)) and 0.0 <= skip <= 1.0):
        return skip
    raise ArgumentError("skip", got=repr(skip), want="'auto', 'exact' or a number in [0, 1]")


def checked_scale(scale: float) -> float:
    """Return display over render size.

    Raises:
        ArgumentError: it is less than 1 or not finite.
    """
    if not 1.0 <= scale < float("inf"):
        raise ArgumentError("scale", got=scale, want="a number >= 1: display size over render size")
    return float(scale)


def checked_size(name: str, size: Size) -> Size:
    """Return (width, height) as whole numbers.

    Raises:
        ArgumentError: they are none, or less than 1.
    """
    try:
        width, height = (int(n) for n in size)
    except (TypeError, ValueError):
        raise ArgumentError(name, got=repr(size), want="(width, height) in pixels") from None
    if width < 1 or height < 1:
        raise ArgumentError(name, got=(width, height), want="(width, height), each at least 1")
    return width, height
