"""The oracle: the best weight between this frame and the past, chosen pixel by pixel with the reference.

Nothing that only chooses this weight does better, so the way from a heuristic to the oracle is what there is
to gain. Its history is its own output, as everyone's.
"""

import numpy as np
import torch
from torch import Tensor

from supersampler.backends.onnx.session import frame_inputs, planes_of
from supersampler.frame import Float32, Size
from supersampler.io.shot import ShotFrame
from supersampler_model.methods import base as method
from supersampler_model.methods.classifier.buffers import History
from supersampler_model.methods.classifier.model import Classifier
from supersampler_model.ops.color import bounded, inverse_tone, tone
from supersampler_model.ops.sampling import View


class Oracle:
    """Steps through a shot of which every frame has a reference.

    Args:
        display_size: (width, height) of the references.
    """

    def __init__(self, display_size: Size) -> None:
        self._display = method.Size(*display_size)
        self._method = Classifier().eval()  # for its gather stage; nothing learned is asked
        self._before: tuple[History, View] | None = None

    def step(self, item: ShotFrame) -> Float32:
        """Return the best image (H, W, 3), linear RGB; where there is no reference, the warped past."""
        frame, render = item.frame, method.Size(*item.frame.size)
        now = View(self._display, render, torch.tensor([frame.jitter], dtype=torch.float32))
        if frame.reset or self._before is None:
            image, state, classes, surface, _, exposure = self._method.first_history(self._display, render)
            self._before = History(image, state, classes, surface, exposure), now
        inputs = frame_inputs(frame, self._display, ("color", "depth", "motion"))
        color, depth, motion = (torch.from_numpy(planes) for planes in inputs.values())
        given = torch.tensor([frame.exposure or 0.0], dtype=torch.float32)
        history, view = self._before
        with torch.no_grad():
            gathered = self._method.gather(color, depth, motion, given, history, now, view)
            present, past = gathered.current.frame, gathered.warped.color
            known = gathered.reprojection.on_screen * (history.exposure.abs() > 0.0)
            toned = past
            if item.reference is not None:
                toned = tone(torch.from_numpy(planes_of(item.reference)) * gathered.exposure)
            blend = present + known * best_weight(present, past, toned) * (past - present)
            image = bounded(inverse_tone(blend) / gathered.exposure)
        self._before = history._replace(color=image, depth=gathered.surfaces, exposure=gathered.followed), now
        return np.ascontiguousarray(image[0].permute(1, 2, 0).numpy())


def best_weight(present: Tensor, past: Tensor, truth: Tensor) -> Tensor:
    """Weight of the past, (1, 1, H, W) in [0, 1], of least squared error; all else (1, 3, H, W)."""
    change = past - present
    along = ((truth - present) * change).sum(dim=1, keepdim=True)
    return (along / (change * change).sum(dim=1, keepdim=True).clamp(min=1e-8)).clamp(0.0, 1.0)
