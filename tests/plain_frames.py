"""A correct frame without features, and what the checks say about frames."""

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from supersampler.arguments import Validate
from supersampler.errors import FrameError, FrameWarning
from supersampler.frame import Frame, Size
from supersampler.validation import FrameChecker

SIZE = WIDTH, HEIGHT = 80, 60
"""All of these pixels are read."""


def plain_frame(**fields: Any) -> Frame:
    """Return a smooth slope in even light, at rest."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    plain: dict[str, Any] = {
        "color": np.repeat((0.4 + 0.001 * x)[..., None], 3, axis=2),
        "depth": 0.1 + 0.001 * x + 0.002 * y,
        "motion": np.zeros((HEIGHT, WIDTH, 2), np.float32),
        "jitter": (0.1, -0.2),
    }
    return Frame(**{**plain, **fields})


def complaints(
    *frames: Frame,
    validate: Validate = "warn",
    display: Size | None = None,
    converges: bool = True,
    gbuffers: Sequence[str] = (),
) -> str:
    """Return all messages about consecutive frames, one a line; an error ends them."""
    checker = FrameChecker(validate, converges=converges)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", FrameWarning)
        try:
            for frame in frames:
                checker.check(frame, display or (2 * frame.size[0], 2 * frame.size[1]), gbuffers)
        except FrameError as error:
            return "\n".join([*(str(each.message) for each in caught), str(error)])
    return "\n".join(str(each.message) for each in caught)
