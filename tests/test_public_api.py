"""What `from supersampler import ...` offers is what `__all__` says, and each name explains itself."""

import types

import pytest

import supersampler


def test_all_names_exactly_what_is_public() -> None:
    public = [
        name
        for name, value in vars(supersampler).items()
        if not name.startswith("_") and not isinstance(value, types.ModuleType)
    ]
    assert sorted(supersampler.__all__) == sorted(public)  # its own order is ruff's to check (RUF022)


@pytest.mark.parametrize("name", supersampler.__all__)
def test_a_public_class_or_function_has_a_docstring_of_its_own(name: str) -> None:
    value = getattr(supersampler, name)
    if callable(value):
        assert value.__doc__
        assert not value.__doc__.startswith(f"{name}(")  # what a dataclass writes by itself
        assert value.__module__.startswith("supersampler.")
