"""The view of an OpenColorIO configuration: linear light to what Blender, for one, shows of it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from OpenImageIO import FLOAT, ImageBuf, ImageBufAlgo

from supersampler.errors import ShotError
from supersampler.frame import Float32
from supersampler.io.atomic import check_is_file
from supersampler.io.display import checked_image

_LINEAR = "scene_linear"  # a role that every configuration has


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewTransform:
    """A display and view of an OpenColorIO configuration, with Blender's exposure and gamma.

    Attributes:
        config: file of the configuration.
        display, view: names in it, such as "sRGB" and "AgX".
        look: name of a look in it; "" and "None" are none.
        exposure: in stops; it doubles the light each.
        gamma: > 0; the shown values are raised to 1 / gamma.
    """

    config: str
    display: str
    view: str
    look: str = ""
    exposure: float = 0.0
    gamma: float = 1.0

    def show(self, image: Float32) -> Float32:
        """Return (h, w, 3) float32 in [0, 1] of (h, w, 3) linear RGB (Rec. 709 primaries).

        Raises:
            ShotError: there is no such configuration, display, view or look.
        """
        check_is_file(Path(self.config))
        light = checked_image("image", image).astype(np.float32) * np.float32(2.0**self.exposure)
        shown = ImageBufAlgo.ociodisplay(
            ImageBuf(np.ascontiguousarray(light)),
            self.display,
            self.view,
            fromspace=_LINEAR,
            looks="" if self.look == "None" else self.look,
            unpremult=False,
            colorconfig=self.config,
        )
        if shown.has_error:
            raise ShotError(
                self.config, f"has no such view ({shown.geterror()})", "Is it Blender's own file?"
            )
        values = np.asarray(shown.get_pixels(FLOAT), np.float32).clip(0.0, 1.0)
        return values ** np.float32(1.0 / max(self.gamma, 1e-6))
