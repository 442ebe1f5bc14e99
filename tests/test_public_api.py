"""`from supersampler import ...` offers the names of `__all__`, and each has a docstring."""

import types

import pytest

import supersampler


def test_all_lists_exactly_the_public_names() -> None:
    there = {name for name in dir(supersampler) if not name.startswith("_")}
    modules = {name for name in there if isinstance(getattr(supersampler, name), types.ModuleType)}
    helpers = {"Any", "TYPE_CHECKING", "did_you_mean", "import_module"}
    assert set(supersampler.__all__) == there - modules - helpers
    assert len(supersampler.__all__) == 18


@pytest.mark.parametrize(
    ("name", "answer"),
    [
        ("Upscalar", "no attribute 'Upscalar'. Did you mean 'Upscaler'?"),
        ("Converter", "no attribute 'Converter'. It is in supersampler.conventions"),
        ("ShotWriter", "no attribute 'ShotWriter'. It is in supersampler.io.shot"),
        ("ProviderError", "no attribute 'ProviderError'. It is in supersampler.errors"),
        ("display_transform", "no attribute 'display_transform'. It is in supersampler.io.display"),
        ("detect_conventions", "no attribute 'detect_conventions'. It is in supersampler.validation"),
        ("qqq", "no attribute 'qqq'"),
    ],
)
def test_an_unknown_name_is_an_attribute_error_with_a_hint(name: str, answer: str) -> None:
    with pytest.raises(AttributeError) as caught:
        getattr(supersampler, name)
    assert str(caught.value) == f"module 'supersampler' has {answer}"
