"""Errors survive pickling and copying, as process pools need."""

import copy
import multiprocessing
import pickle
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

import pytest

from supersampler import ArgumentError, FrameError, Shot, ShotError, SupersamplerError
from supersampler.arguments import checked_scale
from supersampler.conventions.jitter import check_ratio

PACKAGES = ("supersampler", "supersampler_model", "supersampler_export", "supersampler_bench")
APART = ("bpy", "blender.extension", "render_frames", "pyvista", "vtk", "__main__")


def classes() -> list[type[SupersamplerError]]:
    for name in PACKAGES:
        for module in walk_packages(import_module(name).__path__, f"{name}."):
            if "errors" in module.name or "graph" in module.name:
                import_module(module.name)
    found, waiting = [], [SupersamplerError]
    while waiting:
        kind = waiting.pop()
        found.append(kind)
        waiting += kind.__subclasses__()
    return sorted({kind for kind in found if kind.__module__.startswith("supersampler")}, key=repr)


def made(kind: type[SupersamplerError]) -> SupersamplerError:
    """An error of the class, by whichever arguments it takes."""
    attempts: tuple[Callable[[], SupersamplerError], ...] = (
        lambda: kind("name", got=(3, 4), want="(4, 3)", hint="Turn it."),  # type: ignore[call-arg]
        lambda: kind(Path("a/b.exr"), "is damaged", "Copy it."),
        lambda: kind(Path("a"), "lacks 2", "Render it.", gaps={(2, 2): "is missing"}, present=(1, 3)),  # type: ignore[call-arg]
        lambda: kind("a message"),
    )
    for attempt in attempts:
        try:
            return attempt()
        except TypeError:
            continue
    raise AssertionError(kind)


@pytest.mark.parametrize("kind", classes(), ids=lambda kind: kind.__name__)
def test_every_error_is_the_same_after_pickling_and_copying(kind: type[SupersamplerError]) -> None:
    error = made(kind)
    for again in (pickle.loads(pickle.dumps(error)), copy.copy(error), copy.deepcopy(error)):  # noqa: S301
        assert type(again) is kind
        assert str(again) == str(error)
        assert vars(again) == vars(error)


def test_an_error_of_a_file_that_quotes_another_error_has_one_mark_at_its_end() -> None:
    quoted = ArgumentError("preset", got="'unrael'", want="unreal")
    assert str(ShotError("a.json", f"is not valid: {quoted}", "Correct it.")) == (
        "a.json: is not valid: preset is 'unrael'; want unreal. Correct it."
    )
    asked = ArgumentError("preset", got="'unrael'", want="unreal", hint="Is it a typo?")
    assert str(ShotError("a.json", f"is not valid: {asked}")).endswith("want unreal. Is it a typo?")


def test_all_error_classes_are_found() -> None:
    names = {kind.__name__ for kind in classes()}
    assert {"FrameError", "ShotError", "DeviceError", "ExportError", "GltfError"} <= names


@pytest.mark.parametrize(
    ("function", "arguments", "kind"),
    [
        (Shot.open, ("no-such-shot",), ShotError),
        (checked_scale, ("x",), ArgumentError),
        (check_ratio, ((1.0, 3.0), (10, 10), (100, 100)), FrameError),
    ],
)
def test_a_pool_of_processes_passes_errors_on(
    function: Callable[..., object], arguments: tuple[object, ...], kind: type[Exception]
) -> None:
    with multiprocessing.get_context("spawn").Pool(1) as pool, pytest.raises(kind):
        pool.apply_async(function, arguments).get(60)
