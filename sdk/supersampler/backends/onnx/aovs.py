"""`AovBlender`: blends AOVs (alpha, other channels) with the weights of the colour (`aovs.onnx`)."""

import numpy as np

from supersampler.backends.base import ForkSafeLock
from supersampler.backends.onnx.runtime import ort
from supersampler.backends.onnx.session import frame_inputs, open_session, running
from supersampler.errors import FrameError, ModelError
from supersampler.frame import Float32, Frame, Size
from supersampler.methods.aovs.spec import AOVS
from supersampler.methods.model_info import ModelInfo, TensorInfo
from supersampler.methods.spec import TENSORS, dtype_of

_INPUTS = [
    *(TensorInfo(name, dtype_of(name), TENSORS[name]) for name in AOVS.inputs),
    *(TensorInfo(name, "float32", shape) for name, shape in AOVS.graph_history.items()),
]
_OUTPUTS = [TensorInfo("image", "float32", AOVS.image)]


def check_aovs(frame: Frame, history: Float32 | None) -> None:
    """Raise FrameError unless the frame has AOVs, with as many channels as `history` (1, k, H, W)."""
    if frame.aovs is None:
        raise FrameError("aovs", got=None, want="(h, w, k), as it is asked for")
    channels = frame.aovs.shape[2]
    if history is not None and history.shape[1] != channels:
        want = f"{history.shape[1]} channels as before, or a reset"
        raise FrameError("aovs", got=f"{channels} channels", want=want)


class AovBlender:
    """Runs a model's graph for AOVs, loaded on first use; threads may share it."""

    def __init__(self, info: ModelInfo, options: ort.SessionOptions) -> None:
        self._path, self._options = info.aovs_path, options
        self._lock = ForkSafeLock()
        self._session: ort.InferenceSession | None = None

    def blend(
        self, frame: Frame, weight: Float32 | None, history: Float32 | None, display_size: Size
    ) -> Float32:
        """Upsample the channels to display size and blend them with their history.

        Args:
            frame: with `aovs` (h, w, k); see `check_aovs`.
            weight: (1, 1, H, W) weight of the history; None for a method without one.
            history: (1, k, H, W) blended AOVs of the previous frame; None without them.
            display_size: (W, H).

        Returns:
            (1, k, H, W) float32.
        """
        inputs = frame_inputs(frame, display_size, ("aovs", "depth", "motion", "jitter", "display_size"))
        shape = (1, inputs["aovs"].shape[1], *display_size[::-1])
        if weight is None or history is None:
            weight = np.zeros((1, 1, *shape[2:]), np.float32)
        inputs |= {
            "weight": weight,
            "history.aovs": np.zeros(shape, np.float32) if history is None else history,
        }
        session = self._loaded()
        with running(self._path):
            image: Float32 = session.run(["image"], inputs)[0]
        if image.shape != shape:
            raise ModelError(f"{self._path}: gives {image.shape} for 'image'; want {shape}.")
        return image

    def _loaded(self) -> ort.InferenceSession:
        with self._lock.lock:
            if self._session is None:
                self._session = open_session(
                    self._path, self._options, ["CPUExecutionProvider"], takes=_INPUTS, gives=_OUTPUTS
                )
            return self._session
