"""Tests of `ViewTransform` with a small OpenColorIO configuration."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from supersampler import ArgumentError, ShotError
from supersampler.io.view_transform import ViewTransform

CONFIG = """
ocio_profile_version: 2
roles: {scene_linear: linear, default: linear}
file_rules: [!<Rule> {name: Default, colorspace: default}]
displays:
  screen:
    - !<View> {name: As it is, colorspace: linear}
    - !<View> {name: Root, colorspace: root}
looks:
  - !<Look> {name: Half, process_space: linear, transform: !<MatrixTransform> {matrix: [0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 1]}}
colorspaces:
  - !<ColorSpace> {name: linear}
  - !<ColorSpace> {name: root, from_scene_reference: !<ExponentTransform> {value: [0.5, 0.5, 0.5, 1]}}
"""  # noqa: E501
LIGHT = np.array([[[0.04, 0.16, 0.25], [0.0, 1.0, 4.0]]], np.float32)


@pytest.fixture
def view(tmp_path: Path) -> ViewTransform:
    path = tmp_path / "config.ocio"
    path.write_text(CONFIG)
    return ViewTransform(config=str(path), display="screen", view="Root")


def test_light_is_shown_as_the_view_says_and_clipped(view: ViewTransform) -> None:
    np.testing.assert_allclose(view.show(LIGHT), np.minimum(np.sqrt(LIGHT), 1), atol=1e-4)
    assert view.show(LIGHT).dtype == np.float32
    none = replace(view, view="As it is", look="None")
    np.testing.assert_allclose(none.show(LIGHT), np.minimum(LIGHT, 1), atol=1e-6)


def test_exposure_is_in_stops_before_the_view_and_gamma_comes_after(view: ViewTransform) -> None:
    brighter = replace(view, exposure=-2.0).show(LIGHT)
    np.testing.assert_allclose(brighter, np.sqrt(LIGHT / 4), atol=1e-4)
    np.testing.assert_allclose(replace(view, gamma=0.5).show(LIGHT), np.minimum(LIGHT, 1), atol=1e-4)


def test_a_look_comes_before_the_view(view: ViewTransform) -> None:
    np.testing.assert_allclose(
        replace(view, look="Half").show(LIGHT), np.minimum(np.sqrt(LIGHT / 2), 1), atol=1e-4
    )


@pytest.mark.parametrize("change", [{"view": "AgX"}, {"display": "sRGB"}, {"look": "Punchy"}])
def test_a_name_that_the_configuration_has_not_is_refused(
    view: ViewTransform, change: dict[str, Any]
) -> None:
    with pytest.raises(ShotError, match=r"config\.ocio: has no such view"):
        replace(view, **change).show(LIGHT)


def test_a_missing_configuration_and_no_image_are_refused(view: ViewTransform) -> None:
    with pytest.raises(ShotError, match="there is no such file"):
        replace(view, config=f"{view.config}.gone").show(LIGHT)
    with pytest.raises(ArgumentError, match=r"image is .*; want"):
        view.show(LIGHT[..., 0])
