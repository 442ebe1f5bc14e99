"""Models of the package, each loaded once in a process: tests share them, as the sessions of a program do."""

from functools import cache
from typing import Any

from supersampler import Model


@cache
def shared_model(method: str, executor: Any = "auto", **options: Any) -> Model:
    """Return `Model.load(method, executor, **options)`, on one thread by default."""
    return Model.load(method, executor=executor, **{"threads": 1, **options})
