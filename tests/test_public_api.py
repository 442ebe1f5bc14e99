"""What `from supersampler import ...` offers is what `__all__` says, and each name explains itself."""

import types

import pytest

import supersampler


def test_all_names_exactly_what_is_public() -> None:
    there = {name for name in dir(supersampler) if not name.startswith("_")}
    modules = {name for name in there if isinstance(getattr(supersampler, name), types.ModuleType)}
    helpers = {"Any", "TYPE_CHECKING", "import_module"}
    assert set(supersampler.__all__) == there - modules - helpers


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Upscalar'"):
        supersampler.Upscalar  # noqa: B018 - the attribute access is the test


@pytest.mark.parametrize("name", supersampler.__all__)
def test_a_public_class_or_function_has_a_docstring_of_its_own(name: str) -> None:
    value = getattr(supersampler, name)
    assert value.__doc__
    assert not value.__doc__.startswith(f"{name}(")  # what a dataclass writes by itself
    assert value.__module__.startswith("supersampler.")
