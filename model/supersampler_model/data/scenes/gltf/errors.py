"""Errors of glTF files, with the reason and the place in the file.

GltfError       a DataError: names the file, the place in it and the reason
  MalformedError  used inside this package: the reason; each enclosing `at` adds a place
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from supersampler_model.data.errors import DataError, SceneError


class GltfError(DataError, ValueError):
    """A glTF file is broken, or uses unsupported features.

    Attributes:
        path: the file.
        place: where in it, as "mesh 0 'Chair', primitive 1"; empty if it is the whole file.
        problem: the reason.
    """

    def __init__(self, path: Path, place: str, problem: str) -> None:
        self.path, self.place, self.problem = path, place, problem
        super().__init__(f"{path}: {place}{': ' if place else ''}{problem}.")


class MalformedError(Exception):
    """A reason, without its place."""

    def __init__(self, problem: str) -> None:
        super().__init__(problem)
        self.problem, self.places = problem.rstrip("."), list[str]()


@contextmanager
def at(place: str) -> Iterator[None]:
    """Add `place` to errors that are raised inside, also to those of unexpected JSON."""
    try:
        yield
    except MalformedError as error:
        error.places.insert(0, place)
        raise
    except SceneError as error:
        raise _placed(str(error), place) from error
    except KeyError as error:
        raise _placed(f"{error} is missing", place) from error
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError) as error:
        raise _placed(f"this is not as glTF 2.0 has it ({error})", place) from error


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Convert errors that are raised inside to a GltfError of `path`."""
    try:
        with at(""), np.errstate(all="ignore"):  # damaged numbers are found by checks, and named
            yield
    except MalformedError as error:
        raise GltfError(path, ", ".join(filter(None, error.places)), error.problem) from error
    except MemoryError as error:
        raise GltfError(path, "", "there is not enough memory for what it holds") from error
    except OSError as error:
        raise GltfError(path, "", f"it cannot be read ({error})") from error


def _placed(problem: str, place: str) -> MalformedError:
    malformed = MalformedError(problem)
    malformed.places.append(place)
    return malformed
