"""The `Model` that an `Upscaler` is asked to run."""

from collections.abc import Sequence
from pathlib import Path

from supersampler.checked import as_flag, as_index
from supersampler.errors import ArgumentError
from supersampler.model import ExecutorName, Model, Precision


def loaded_model(
    model: Model | str | Path,
    providers: str | Sequence[str],
    threads: int,
    executor: ExecutorName,
    precision: Precision,
    *,
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
    words = {"providers": providers, "executor": executor, "precision": precision}
    set_again = [name for name, word in words.items() if not (isinstance(word, str) and word == "auto")]
    set_again += ["threads"] * (as_index(threads) != 0) + ["capture"] * (as_flag(capture) is not False)
    if set_again:
        raise ArgumentError(" and ".join(set_again), got="set beside a Model", want="set in Model.load")
    return model
