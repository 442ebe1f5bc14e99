"""The options that choose what PNG, TIFF and video files show."""

from typing import TYPE_CHECKING, Annotated

import typer

from supersampler.errors import ArgumentError

if TYPE_CHECKING:
    from supersampler.io.display_transforms import DisplayTransform

Ocio = Annotated[
    str | None,
    typer.Option(
        "--ocio",
        metavar="CONFIG",
        help="OpenColorIO configuration of png, tif, mp4: a file, ocio://default, or "
        "ocio://studio-config-latest (ACES 2).",
        show_default="with --display, --view or --look: $OCIO, or the studio config",
    ),
]
Display = Annotated[
    str | None, typer.Option("--display", help="Display of the configuration.", show_default="its first")
]
View = Annotated[
    str | None, typer.Option("--view", help="View of that display.", show_default="the display's first")
]
Look = Annotated[
    str | None, typer.Option("--look", help="Look of the configuration.", show_default="the view's")
]
Exposure = Annotated[
    float | None,
    typer.Option(
        "--exposure",
        metavar="STOPS",
        help="Exposure of png, tif, mp4.",
        show_default="the frame's, or measured; 0 with --ocio",
    ),
]


def display_transform_of(
    *,
    color_space: str,
    srgb: bool,
    ocio: str | None = None,
    display: str | None = None,
    view: str | None = None,
    look: str | None = None,
    exposure: float | None = None,
) -> "DisplayTransform":
    """Return `display_transform_from` of the options; errors name the options as they are typed.

    Args:
        color_space: colour space of the shot's linear light.
        srgb: whether the shot's colour is sRGB-encoded (`shot.conventions.srgb`).
        ocio: --ocio.
        display: --display.
        view: --view.
        look: --look.
        exposure: --exposure.

    Raises:
        ArgumentError, ShotError: a name is not in the configuration, or it cannot be read.
    """
    from supersampler.io.display_transforms import display_transform_from

    try:
        return display_transform_from(
            color_space=color_space,
            srgb=srgb,
            ocio=ocio,
            display=display,
            view=view,
            look=look,
            exposure=exposure,
        )
    except ArgumentError as error:
        option = f"--{error.name.replace('_', '-')}"
        raise ArgumentError(option, got=error.got, want=error.want, hint=error.hint) from error
