"""Tests of the display transform and of measured exposure, with invalid pixels, too."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from supersampler import ArgumentError, Frame, ShotError
from supersampler.conventions.encodings import srgb_encoded
from supersampler.io.display import ExposureMeter, auto_exposure, display_transform, to_uint8
from supersampler.io.display_transforms import display_transform_from, ocio_transform

HOSTILE = np.array(
    [[[np.nan, np.inf, -np.inf], [-1.0, 65504.0, 1e-45]], [[0.0, 0.0, 0.0], [1e38, 1.0, 0.5]]], np.float32
)


def grey(value: float) -> np.ndarray:
    return np.full((2, 3, 3), value, np.float32)


def frame_of(color: np.ndarray | None, **values: Any) -> Frame:
    motion = np.zeros((2, 3, 2), np.float32)  # of the size of `grey`
    return Frame(color=color, depth=motion[..., 0], motion=motion, jitter=(0.0, 0.0), **values)


@pytest.mark.parametrize(("linear", "encoded"), [(0.0, 0.0), (0.001, 0.01292), (0.5, 0.735357), (1.0, 1.0)])
def test_srgb_is_the_standard_one(linear: float, encoded: float) -> None:
    assert srgb_encoded(grey(linear))[0, 0, 0] == pytest.approx(encoded, abs=1e-5)


def test_the_curve_divides_by_one_plus_the_largest_channel() -> None:
    color = np.array([[[3.0, 1.0, 0.5]]], np.float32)
    expected = srgb_encoded(color * 2.0 / (1.0 + 6.0))
    np.testing.assert_allclose(display_transform(color, 2.0), expected, rtol=1e-6)


@given(hnp.arrays(np.float32, (1, 2, 3), elements=st.floats(0, 1024, width=32)), st.floats(0.01, 100))
def test_more_light_is_never_darker_in_its_largest_channel(color: np.ndarray, gain: float) -> None:
    less, more = display_transform(color, gain), display_transform(color, gain * 2)
    assert (more.max(axis=-1) >= less.max(axis=-1) - 1e-6).all()


def test_bytes_are_rounded_not_cut_off() -> None:
    values = np.array([-1.0, 0.0, 0.499 / 255, 0.501 / 255, 1.0, 2.0])
    assert to_uint8(values).tolist() == [0, 0, 0, 1, 255, 255]


def test_the_log_average_of_a_grey_image_comes_to_middle_grey() -> None:
    assert auto_exposure(grey(0.5)) == pytest.approx(0.36, rel=1e-5)


def test_too_bright_pixels_count_as_65504_and_black_ones_and_nan_not_at_all() -> None:
    assert auto_exposure(grey(0.0)) == auto_exposure(grey(-1.0)) == auto_exposure(grey(np.nan)) == 0.18
    assert auto_exposure(grey(np.inf)) == auto_exposure(grey(1e30)) == pytest.approx(0.18 / 65504.0)
    for other in (np.nan, 0.0, -1.0, 1e-4):
        assert auto_exposure(np.concatenate([grey(0.5), grey(other)])) == pytest.approx(0.36, rel=1e-5)
    assert auto_exposure(grey(1.01e-4)) == pytest.approx(0.18 / 1.01e-4, rel=1e-5)


def test_the_meter_takes_the_engines_exposure_as_it_is_or_measures_without_pre_exposure() -> None:
    assert ExposureMeter().read_frame(frame_of(grey(1.0), exposure=2.5)) == 2.5
    assert ExposureMeter().read_frame(frame_of(grey(0.72), pre_exposure=4.0)) == pytest.approx(1.0)
    assert ExposureMeter().read_frame(frame_of(grey(0.72), exposure=2.5, pre_exposure=4.0)) == 2.5


def test_the_meter_follows_slowly_until_a_cut() -> None:
    meter = ExposureMeter()
    assert meter.read_frame(frame_of(grey(0.18))) == pytest.approx(1.0)
    assert meter.read_frame(frame_of(grey(1.8))) == pytest.approx(0.1**0.1)
    assert meter.read_frame(frame_of(None)) == pytest.approx(0.1**0.1)  # a frame that was not shaded
    assert meter.read_frame(frame_of(grey(0.0))) == pytest.approx(0.1**0.1)  # black
    assert meter.read_frame(frame_of(grey(1.8), reset=True)) == pytest.approx(0.1)


# --- what PNG, TIFF and video files show: the tone curve, sRGB alone, OpenColorIO views ---


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


AP1_TO_REC709 = [  # Bradford-adapted, as in the ACES documents, for column vectors
    [1.7050510, -0.6217921, -0.0832589],
    [-0.1302564, 1.1408047, -0.0105483],
    [-0.0240034, -0.1289690, 1.1529723],
]


@pytest.fixture
def config(tmp_path: Path) -> str:
    path = tmp_path / "config.ocio"
    path.write_text(CONFIG)
    return str(path)


def test_without_options_exposure_tone_curve_and_srgb_are_shown() -> None:
    transform = display_transform_from()
    assert transform.stops is None
    np.testing.assert_array_equal(transform.show(LIGHT, 0.3), display_transform(LIGHT, 0.3))


def test_acescg_is_converted_to_rec_709_before_the_tone_curve() -> None:
    light = np.array([[[0.2, 0.5, 0.1], [0.3, 0.3, 0.3]]], np.float32)
    shown = display_transform_from(color_space="ACEScg").show(light, 2.0)
    expected = display_transform(light @ np.transpose(AP1_TO_REC709), 2.0)
    np.testing.assert_allclose(shown, expected, atol=1e-5)
    assert np.ptp(shown[0, 1]) < 1e-5  # grey stays grey: the white point is adapted


@pytest.mark.parametrize(
    "options", [{}, {"color_space": "ACEScg"}, {"srgb": True}, {"view": "ACES 2.0 - SDR 100 nits (Rec.709)"}]
)
def test_hostile_pixels_stay_inside_the_range(options: dict[str, Any]) -> None:
    shown = display_transform_from(**options).show(HOSTILE, 3.0)
    assert shown.dtype == np.float32
    assert np.isfinite(shown).all()
    assert (shown.min() >= 0.0, shown.max() <= 1.0) == (True, True)


def test_srgb_frames_come_back_clipped_and_encoded_without_exposure_and_curve() -> None:
    transform = display_transform_from(srgb=True)
    np.testing.assert_allclose(transform.show(LIGHT, 5.0), srgb_encoded(LIGHT.clip(0, 1)), atol=1e-6)
    brighter = display_transform_from(srgb=True, exposure=1.0).show(LIGHT)
    np.testing.assert_allclose(brighter, srgb_encoded((LIGHT * 2).clip(0, 1)), atol=1e-6)


def test_a_view_shows_light_as_the_configuration_says_and_clips_it(config: str) -> None:
    root = ocio_transform(config, "screen", "Root")
    np.testing.assert_allclose(root.show(LIGHT, 7.0), np.minimum(np.sqrt(LIGHT), 1), atol=1e-4)
    assert root.show(LIGHT).dtype == np.float32
    none = ocio_transform(config, "screen", "As it is", look="None")
    np.testing.assert_allclose(none.show(LIGHT), np.minimum(LIGHT, 1), atol=1e-6)


def test_exposure_comes_before_the_view_and_gamma_after_it(config: str) -> None:
    darker = ocio_transform(config, "screen", "Root", stops=-2.0).show(LIGHT)
    np.testing.assert_allclose(darker, np.sqrt(LIGHT / 4), atol=1e-4)
    linear = ocio_transform(config, "screen", "Root", gamma=0.5).show(LIGHT)
    np.testing.assert_allclose(linear, np.minimum(LIGHT, 1), atol=1e-4)


def test_a_look_comes_before_the_view(config: str) -> None:
    half = ocio_transform(config, "screen", "Root", look="Half").show(LIGHT)
    np.testing.assert_allclose(half, np.minimum(np.sqrt(LIGHT / 2), 1), atol=1e-4)


def test_display_and_view_are_the_configurations_first_by_default(config: str) -> None:
    found: Any = display_transform_from(ocio=config).ocio
    assert (found.display, found.view) == ("screen", "As it is")


def test_the_configuration_is_the_environments_or_studio(
    config: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("OCIO", raising=False)
    studio: Any = display_transform_from(view="Un-tone-mapped").ocio
    assert (studio.config, studio.display) == ("ocio://studio-config-latest", "sRGB - Display")
    monkeypatch.setenv("OCIO", config)
    of_environment: Any = display_transform_from(view="Root").ocio
    assert of_environment.config == config
    assert display_transform_from().ocio is None  # the variable alone asks for no view


def test_a_view_takes_the_colour_space_of_the_shot_into_account() -> None:
    light = np.array([[[0.2, 0.5, 0.1]]], np.float32)
    ap1 = display_transform_from(color_space="ACEScg", view="Un-tone-mapped").show(light)
    expected = srgb_encoded((light @ np.transpose(AP1_TO_REC709)).astype(np.float32)).clip(0, 1)
    np.testing.assert_allclose(ap1, expected, atol=1e-4)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"view": "Rot"}, r"view is 'Rot'; want one of As it is, Root\. Did you mean 'Root'\?"),
        ({"display": "screan"}, r"display is 'screan'; want one of screen\. Did you mean 'screen'\?"),
        ({"look": "+Haf"}, r"look is 'Haf'; want one of Half\. Did you mean 'Half'\?"),
        ({"color_space": "rot"}, r"color_space is 'rot'; want one of linear, root\. Did you mean 'root'\?"),
    ],
)
def test_a_name_missing_from_the_configuration_is_refused_before_any_image(
    config: str, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(ArgumentError, match=message):
        display_transform_from(ocio=config, **options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"ocio": "ocio://studio-config-lates"}, "ocio is .* Did you mean 'ocio://studio-config-latest'"),
        ({"color_space": "ACEScct"}, r"color_space is 'ACEScct'; want a linear colour .* mean 'ACEScg'"),
        ({"exposure": 25.0}, "exposure is 25.0; want stops, -24 to 24"),
        ({"exposure": float("nan")}, "exposure is nan; want stops, -24 to 24"),
    ],
)
def test_options_that_no_configuration_has_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        display_transform_from(**options)


def test_a_missing_or_damaged_configuration_is_one_line_that_names_it(config: str) -> None:
    with pytest.raises(ShotError, match=r"config\.ocio\.gone: there is no such file"):
        display_transform_from(ocio=f"{config}.gone")
    Path(config).write_text("no configuration")
    with pytest.raises(ShotError, match=r"config\.ocio: is no OpenColorIO configuration \(.*\)") as caught:
        display_transform_from(ocio=config)
    assert "\n" not in str(caught.value)


def test_a_table_that_is_missing_beside_the_configuration_is_refused_before_any_image(config: str) -> None:
    root, table = "ExponentTransform> {value: [0.5, 0.5, 0.5, 1]}", "FileTransform> {src: no.spi1d}"
    Path(config).write_text(Path(config).read_text().replace(root, table))
    with pytest.raises(ShotError, match=r"no\.spi1d"):
        display_transform_from(ocio=config, view="Root")


def test_the_encoding_is_that_of_the_display(config: str) -> None:
    assert display_transform_from().encoding == "srgb_rec709_display"
    assert display_transform_from(display="Display P3 - Display").encoding == "srgb_p3d65_display"
    assert display_transform_from(ocio=config).encoding == "lin_rec709_scene"
    assert display_transform_from(ocio=config, view="Root").encoding == "srgb_rec709_display"  # has no name
