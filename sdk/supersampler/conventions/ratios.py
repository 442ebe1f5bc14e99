"""Check ratios of display size to render size, and compute sizes from them."""

from fractions import Fraction

from supersampler.arguments import checked_size
from supersampler.errors import FrameError
from supersampler.frame import Size


def check_ratio(ratios: tuple[float, float], render_size: Size, display_size: Size) -> None:
    """Raise FrameError unless a method with these ratios (least, largest) upscales between the sizes.

    A range allows for the rounding of either size to whole pixels: some sizes less than a pixel larger or
    smaller have a ratio in it. A method with one ratio computes whole
    blocks of display pixels for each render pixel, and needs exactly that multiple of the render size.
    """
    low, high = ratios
    if low == high:
        display = scaled(render_size, low)
        if display == display_size:
            return
        frames = scaled(display_size, 1.0 / low)
        possible = [f"frames of {frames}"] * (frames is not None)
        possible += [f"a display of {display}"] * (display is not None)
        raise FrameError(
            "size",
            got=f"{render_size}, for a display of {display_size}",
            want=f"{' or '.join(possible) or 'others'}: this method upscales exactly {low:g} times",
            hint="Sizes are (width, height).",
        )
    for axis, name in enumerate(("width", "height")):
        ratio = display_size[axis] / render_size[axis]
        smallest = (display_size[axis] - 1) / (render_size[axis] + 1)
        largest = (display_size[axis] + 1) / max(render_size[axis] - 1, 1)
        if smallest > high or (largest < low and render_size[axis] > 1):
            raise FrameError(
                "size",
                got=f"{render_size}, {ratio:.3g} times less in {name} than the display's {display_size}",
                want=f"a ratio from {low} to {high}",
                hint="Sizes are (width, height).",
            )


def only_ratio(ratios: tuple[float, float]) -> float | None:
    """Return the only ratio, where least and largest are equal; None for a range."""
    low, high = ratios
    return low if low == high else None


def scaled(size: Size, ratio: float) -> Size | None:
    """Return a size `ratio` times as large; None where it is not whole pixels."""
    exact = Fraction(ratio).limit_denominator(1000)  # 0.333... is 1/3
    width, height = size[0] * exact, size[1] * exact
    return (int(width), int(height)) if width.denominator == height.denominator == 1 else None


def display_size_of(render_size: Size, scale: float) -> Size:
    """Return the display size that is `scale` times a render size, rounded to whole pixels.

    Raises:
        ArgumentError: it is not an image size.
    """
    return checked_size("display_size", (round(render_size[0] * scale), round(render_size[1] * scale)))
