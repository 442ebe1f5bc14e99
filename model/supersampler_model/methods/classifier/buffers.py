"""What the stages of `classifier` hand to one another."""

from typing import NamedTuple

from torch import Tensor

from supersampler_model.ops.motion import Past


class Present(NamedTuple):
    """This frame at display size; colours are toned RGB."""

    frame: Tensor  # (1, 3, H, W) cubic upsampling
    sample: Tensor  # (1, 3, H, W) mean of the samples near each pixel
    confidence: Tensor  # (1, 1, H, W) how near they are, [0, 1]
    first: Tensor  # (1, 3, H, W) E[c] of a neighbourhood, YCoCg
    second: Tensor  # (1, 3, H, W) E[c^2]
    window: list[Tensor]  # WINDOW of (1, 4, H, W): samples around each pixel, and their weights at first
    edge: Tensor  # (1, 1, H, W) relative range of depth around
    glare: Tensor  # (1, 1, H, W) 1 where one of 3x3 samples is over GLARING


class Remembered(NamedTuple):
    """The warped past at display size."""

    color: Tensor  # (1, 3, H, W) toned RGB
    detail: Tensor  # (1, 3, H, W) what the cubic has sharpened
    own: Tensor  # (1, 3, H, W) where the pixel's own motion leads, toned RGB
    samples: Tensor  # (1, 1, H, W) how many it is made of; 0 where there is no past
    range: Tensor  # (1, 2, H, W) least and most luma that the samples had
    glare: Tensor  # (1, 1, H, W) frames in a row that have had light over GLARING near, up to CONFIRMED
    difference: Tensor  # (1, 1, H, W) of depth, equation 10
    surface: Tensor  # (1, 1, H, W) 1 where it may show what is there now
    classes: Tensor  # (1, 6, H / 2, W / 2) what the pixels were held for


class Gathered(NamedTuple):
    """All that is known before the network speaks."""

    present: Present
    past: Remembered
    there: Past
    depth: Tensor  # (1, 1, H, W) of the closest sample around
    surfaces: Tensor  # (1, 2, h, w) depth, and that without thin things
    exposure: Tensor  # (1,) > 0
    followed: Tensor  # (1,) the same for the history, see `exposure_for`


class History(NamedTuple):
    """What the frame before left; shapes as in `Classifier.history`."""

    color: Tensor
    state: Tensor
    classes: Tensor
    depth: Tensor
    exposure: Tensor


class Finished(NamedTuple):
    """What a step draws and remembers."""

    image: Tensor  # (1, 3, H, W) linear RGB
    state: Tensor  # as in `Classifier.history`
    classes: Tensor
    weight: Tensor  # (1, 1, H, W) share of the past in the image
