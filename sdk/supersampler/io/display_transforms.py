"""Transforms from linear light to PNG, TIFF and video: a tone curve, an OpenColorIO view, or sRGB alone.

>>> transform = display_transform_from(color_space="ACEScg", view="ACES 2.0 - SDR 100 nits (Rec.709)")
>>> write_png("0001.png", to_uint8(transform.show(image, exposure)))
"""

import hashlib
import math
import os
import re
from collections.abc import Collection
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from OpenImageIO import FLOAT, ColorConfig, ImageBuf, ImageBufAlgo

from supersampler.arguments import as_number, ieee_arithmetic
from supersampler.conventions.encodings import srgb_encoded
from supersampler.errors import ArgumentError, ShotError, did_you_mean, shown
from supersampler.frame import Array, Float32
from supersampler.io.display import MAX_HALF, by_rows, checked_image, display_transform
from supersampler.io.files import check_is_file, os_errors_as_shot_error, utf8_path

REC709 = "lin_rec709"
"""Linear light with the primaries of Rec. 709 and sRGB."""
UNKNOWN_COLOR_SPACE = "unknown"
"""Linear light of files with other primaries than those of known spaces."""
SRGB = "srgb_rec709_display"
"""OpenImageIO's name of the encoding of sRGB displays."""
STUDIO_CONFIG = "ocio://studio-config-latest"
"""The configuration of OpenColorIO that OpenImageIO contains, with the views of ACES 2."""
MAX_STOPS = 24.0

_BUILT_IN_PREFIX = "ocio://"
_BUILT_IN = ("ocio://default", "ocio://cg-config-latest", STUDIO_CONFIG)


@dataclass(frozen=True, slots=True, kw_only=True)
class OcioView:
    """Names of a view in an OpenColorIO configuration, and Blender's gamma after it.

    Attributes:
        config: file of the configuration, or name of a built-in one.
        display, view: names in the configuration, such as "sRGB" and "AgX".
        look: name of a look in the configuration; "": the view's looks.
        gamma: > 0; the view's values are raised to 1 / gamma.
        encoding: OpenImageIO's name of the display's encoding, such as "srgb_p3d65_display".
    """

    config: str
    display: str
    view: str
    look: str = ""
    gamma: float = 1.0
    encoding: str = SRGB

    @ieee_arithmetic
    def show(self, light: Float32, color_space: str) -> Float32:
        """Return (h, w, 3) values in [0, 1] of (h, w, 3) linear RGB in a colour space of the configuration.

        OpenImageIO rebuilds the processor in each call, as it caches processors only for the configuration of
        the environment. This takes much less time than a large image.
        """
        result = ImageBufAlgo.ociodisplay(
            ImageBuf(np.ascontiguousarray(light)),
            self.display,
            self.view,
            fromspace=color_space,
            looks=self.look,
            unpremult=False,
            colorconfig=self.config,
        )
        if result.has_error:
            raise ShotError(self.config, f"cannot show {self.view!r} ({_first_line(result.geterror())})")
        values = np.asarray(result.get_pixels(FLOAT), np.float32)
        np.nan_to_num(values, copy=False, nan=0.0).clip(0.0, 1.0, out=values)
        return values if self.gamma == 1.0 else values ** np.float32(1.0 / max(self.gamma, 1e-6))


@dataclass(frozen=True, slots=True, kw_only=True)
class DisplayTransform:
    """Maps linear light to the values of a display; `display_transform_from` makes it from options.

    Attributes:
        color_space: colour space of the light: the name of a linear space of STUDIO_CONFIG; with `ocio`, a
            name, alias or role of its configuration.
        stops: fixed exposure in stops; None: the exposure is an argument of `show`.
        tone_curve: without `ocio`: whether c / (1 + max(r, g, b)) precedes the sRGB encoding; otherwise
            values are clipped at 1.
        ocio: the OpenColorIO view, or None.
    """

    color_space: str = REC709
    stops: float | None = None
    tone_curve: bool = True
    ocio: OcioView | None = None

    @property
    def description(self) -> str:
        """One line of text about the transform."""
        exposure = "" if self.stops == 0.0 else "exposure"
        exposure += f" of {self.stops:+g} stops" if self.stops else ""
        curve = "c / (1 + max(r, g, b)), sRGB" if self.tone_curve else "clipped to [0, 1], sRGB"
        if self.ocio is not None:
            look = f" with look {self.ocio.look}" if self.ocio.look else ""
            curve = f"view {self.ocio.view}{look} on {self.ocio.display} (OpenColorIO)"
        return f"{exposure}, {curve}".removeprefix(", ")

    @property
    def encoding(self) -> str:
        """OpenImageIO's name of the display's encoding, for the tags of files."""
        return SRGB if self.ocio is None else self.ocio.encoding

    @ieee_arithmetic
    def show(self, image: Array, exposure: float = 1.0) -> Float32:
        """Return the encoded values of an image.

        Args:
            image: (h, w, 3) linear RGB. NaN counts as 0, Inf as 65504.
            exposure: exposure of this frame, > 0; ignored if `stops` is given.

        Returns:
            (h, w, 3) float32 in [0, 1].

        Raises:
            ArgumentError: the image has another shape, or no numbers; or `exposure` is not a number > 0.
            ShotError: a file of the OpenColorIO configuration cannot be read.
        """
        light = checked_image("image", image)
        factor = exposure if self.stops is None else 2.0**self.stops
        if self.ocio is None and self.tone_curve and self.color_space == REC709:
            return display_transform(light, factor)
        if self.ocio is None:
            return by_rows(lambda rows: self._encoded(_finite(rows), factor), light, np.float32)
        light = _finite(light)
        light *= np.float32(factor)
        return self.ocio.show(light, self.color_space)

    def _encoded(self, light: Float32, factor: float) -> Float32:
        """Return the encoded values of finite light, without `ocio`."""
        if self.color_space != REC709:
            light = light @ _matrix_to_rec709(self.color_space)
        if self.tone_curve:
            return display_transform(light, factor)
        return srgb_encoded((light * np.float32(factor)).clip(0.0, 1.0)).clip(0.0, 1.0)

    def at_pre_exposure(self, pre_exposure: float) -> "DisplayTransform":
        """Return the transform for images that are multiplied by a pre-exposure.

        A fixed exposure then applies to the light without pre-exposure; the `exposure` of `show` applies to
        the image as it is. sRGB alone keeps the encoding of the frames, and with it their pre-exposure.
        """
        if self.stops is None or pre_exposure == 1.0 or not self.tone_curve:
            return self
        return replace(self, stops=self.stops - math.log2(pre_exposure))

    def to_json(self) -> dict[str, object]:
        """Return the fields as JSON, and the SHA-256 of a file of the OpenColorIO configuration.

        Raises:
            ShotError: the file cannot be read.
        """
        if self.ocio is None or self.ocio.config.startswith(_BUILT_IN_PREFIX):
            return asdict(self)
        path = self.ocio.config
        with os_errors_as_shot_error(path), Path(path).open("rb") as file:
            return {**asdict(self), "sha256": hashlib.file_digest(file, "sha256").hexdigest()}


DEFAULT_TRANSFORM = DisplayTransform()
"""Transform with the frame's exposure, tone curve and sRGB, for light with the primaries of Rec. 709."""


def display_transform_from(
    *,
    color_space: str = REC709,
    srgb: bool = False,
    ocio: str | None = None,
    display: str | None = None,
    view: str | None = None,
    look: str | None = None,
    exposure: float | None = None,
) -> DisplayTransform:
    """Return the display transform of these options, after a check of all names.

    If `ocio`, `display`, `view` or `look` is given, it is a view of OpenColorIO. Otherwise it is the tone
    curve, or sRGB alone for images that were sRGB-encoded when they were read.

    Args:
        color_space: colour space of the linear images: "lin_rec709", "ACEScg", or another name, alias or role
            of the configuration.
        srgb: whether the images were sRGB-encoded when they were read (`Conventions.srgb`).
        ocio: configuration: a file, "ocio://default" or "ocio://studio-config-latest". By default the value
            of the environment variable OCIO, otherwise STUDIO_CONFIG.
        display: by default the configuration's first.
        view: by default the display's first.
        look: a look, or several, separated by commas.
        exposure: exposure in stops, -24 to 24. By default the exposure of each frame with the tone curve, 0
            without.

    Raises:
        ArgumentError: a name is not in the configuration, the colour space has no tone curve, or `exposure`
            is out of its range.
        ShotError: the configuration cannot be read.
    """
    names = {"ocio": ocio, "display": display, "view": view, "look": look, "color_space": color_space}
    for name, value in names.items():
        is_text = isinstance(value, str) and value.isprintable()
        if not (is_text or (value is None and name != "color_space")):
            raise ArgumentError(name, got=shown(value), want="text")
    stops = as_number(exposure)
    if exposure is not None and (stops is None or not -MAX_STOPS <= stops <= MAX_STOPS):
        want = f"stops, {-MAX_STOPS:g} to {MAX_STOPS:g}"
        raise ArgumentError("exposure", got=shown(exposure), want=want)
    if any(option is not None for option in (ocio, display, view, look)):
        config = ocio or os.environ.get("OCIO") or STUDIO_CONFIG
        return ocio_transform(
            config, display, view, look=look or "", color_space=color_space, stops=stops or 0.0
        )
    if color_space != REC709:
        _matrix_to_rec709(color_space)  # raises for a space that cannot be converted
    if srgb:
        stops = stops or 0.0
    return DisplayTransform(color_space=color_space, stops=stops, tone_curve=not srgb)


def ocio_transform(
    config: str,
    display: str | None = None,
    view: str | None = None,
    *,
    look: str = "",
    color_space: str = REC709,
    stops: float = 0.0,
    gamma: float = 1.0,
) -> DisplayTransform:
    """Return the transform to a view of a configuration, after a check of all names.

    See `display_transform_from` for the arguments and errors. The look "None" is the view's, as in Blender;
    `stops` of exposure precede the view, and `gamma` > 0 follows it.
    """
    if not config.startswith(_BUILT_IN_PREFIX):
        check_is_file(Path(config))
        config = utf8_path(config)
    opened = _open_config(config)
    display = _checked("display", display or opened.getDefaultDisplayName(), opened.getDisplayNames())
    view = _checked("view", view or opened.getDefaultViewName(display), opened.getViewNames(display))
    look = "" if look == "None" else look
    for name in re.split("[,:|]", look) if look else ():
        _checked("look", name.strip().lstrip("+-"), opened.getLookNames())
    if opened.getColorSpaceIndex(opened.resolve(color_space)) < 0:
        _checked("color_space", color_space, opened.getColorSpaceNames())
    shown_space = opened.getDisplayViewColorSpaceName(display, view)
    names = OcioView(
        config=config,
        display=display,
        view=view,
        look=look,
        gamma=gamma,
        encoding=opened.get_color_interop_id(shown_space) or SRGB,
    )
    found = DisplayTransform(color_space=color_space, stops=stops, ocio=names)
    found.show(np.zeros((1, 1, 3), np.float32))  # reads the files that the configuration names
    return found


def _open_config(config: str) -> ColorConfig:
    opened = ColorConfig(config)
    opened.getDisplayNames()  # reads the file; `geterror` knows no error before
    if message := opened.geterror():
        if config.startswith(_BUILT_IN_PREFIX):
            _checked("ocio", config, _BUILT_IN)
        raise ShotError(config, f"is no OpenColorIO configuration ({_first_line(message)})")
    return opened


def _checked(name: str, value: str | None, choices: Collection[str]) -> str:
    """Return a name that is among the choices; ArgumentError for other names."""
    if value not in choices:
        want = f"one of {', '.join(choices)}" if choices else f"a configuration that has a {name}"
        raise ArgumentError(name, got=shown(value), want=want, hint=did_you_mean(value, choices))
    return str(value)


@cache
def _matrix_to_rec709(color_space: str) -> Float32:
    """Return the (3, 3) matrix for row vectors from a linear space of STUDIO_CONFIG to Rec. 709.

    The white point is adapted to D65. ArgumentError if the space is unknown or not linear.
    """
    config = ColorConfig(STUDIO_CONFIG)
    if not config.isColorSpaceLinear(color_space):
        want = f"a linear colour space of {STUDIO_CONFIG}"
        spaces = [name for name in config.getColorSpaceNames() if config.isColorSpaceLinear(name)]
        hint = did_you_mean(color_space, spaces) or "Or choose a view: `supersampler upscale --ocio CONFIG`."
        raise ArgumentError("color_space", got=shown(color_space), want=want, hint=hint)
    primaries = ImageBuf(np.eye(3, dtype=np.float32)[None])
    converted = ImageBufAlgo.colorconvert(
        primaries, color_space, REC709, unpremult=False, colorconfig=STUDIO_CONFIG
    )
    return np.asarray(converted.get_pixels(FLOAT), np.float32).reshape(3, 3)


def _finite(light: Array) -> Float32:
    """Return a copy of light in single precision without NaN and Inf."""
    single: Float32 = np.nan_to_num(light.astype(np.float32, copy=False), posinf=MAX_HALF, neginf=-MAX_HALF)
    return single


def _first_line(message: str) -> str:
    return message.strip().splitlines()[0] if message.strip() else "no reason given"
