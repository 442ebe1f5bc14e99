"""What frames carry along (alpha, any channels), blended by the weight of the colour: `carry.onnx`."""

import threading
from typing import NamedTuple

import numpy as np
import onnxruntime as ort

from supersampler.errors import FrameError
from supersampler.frame import Float32, Frame, Size
from supersampler.graph_session import frame_inputs, open_session
from supersampler.model_info import ModelInfo


class Carried(NamedTuple):
    """A frame's channels and what they are blended with; checked."""

    frame: Frame
    display_size: Size
    past: Float32 | None  # (1, k, H, W) of the frame before; None where it carried nothing


def checked_carry(frame: Frame, display_size: Size, past: Float32 | None) -> Carried:
    """Return the channels, ready to be blended.

    Raises:
        FrameError: the frame carries nothing, or another number of channels than the one before.
    """
    if frame.carry is None:
        raise FrameError("carry", got=None, want="(h, w, k), as it is asked for")
    channels = frame.carry.shape[2]
    if past is not None and past.shape[1] != channels:
        want = f"{past.shape[1]} channels as before, or a reset"
        raise FrameError("carry", got=f"{channels} channels", want=want)
    return Carried(frame, display_size, past)


class Carrier:
    """The graph beside a model's step, loaded when a frame first carries something; safe to share."""

    def __init__(self, info: ModelInfo, options: ort.SessionOptions) -> None:
        self._path, self._options = info.carry_path, options
        self._lock = threading.Lock()
        self._session: ort.InferenceSession | None = None

    def blend(self, carried: Carried, weight: Float32 | None) -> Float32:
        """Bring the channels to display size and blend them with the past.

        Args:
            carried: what.
            weight: (1, 1, H, W) share of the past; None for a method without one.

        Returns:
            (1, k, H, W) float32.
        """
        inputs = frame_inputs(
            carried.frame, carried.display_size, ("carry", "depth", "motion", "jitter", "display_size")
        )
        shape = (1, inputs["carry"].shape[1], *carried.display_size[::-1])
        past = carried.past
        if weight is None or past is None:
            weight = np.zeros((1, 1, *shape[2:]), np.float32)
        inputs |= {"weight": weight, "history.carry": np.zeros(shape, np.float32) if past is None else past}
        image: Float32 = self._loaded().run(["image"], inputs)[0]
        return image

    def _loaded(self) -> ort.InferenceSession:
        with self._lock:
            if self._session is None:
                self._session = open_session(self._path, self._options, ["CPUExecutionProvider"])
            return self._session
