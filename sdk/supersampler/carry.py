"""What frames carry along (alpha, any channels), blended by the weight of the colour: `carry.onnx`."""

import threading

import numpy as np
import onnxruntime as ort

from supersampler.errors import FrameError, ModelError
from supersampler.frame import Float32, Frame, Size
from supersampler.model_info import ModelInfo


class Carrier:
    """The graph beside a model's step, loaded when a frame first carries something; safe to share."""

    def __init__(self, info: ModelInfo, options: ort.SessionOptions) -> None:
        self._path, self._options = info.carry_path, options
        self._lock = threading.Lock()
        self._session: ort.InferenceSession | None = None

    def blend(self, frame: Frame, weight: Float32, past: Float32 | None, display_size: Size) -> Float32:
        """Bring the channels to display size and blend them with the past.

        Args:
            frame: with `carry` (h, w, k).
            weight: (1, 1, H, W) share of the past.
            past: (1, k, H, W) of the frame before; None where it carried nothing, which is no past.
            display_size: (W, H).

        Returns:
            (1, k, H, W) float32.

        Raises:
            FrameError: the frame carries nothing, or another number of channels than the one before.
        """
        if frame.carry is None:
            raise FrameError("carry", got=None, want="(h, w, k), as it is asked for")
        planes = np.ascontiguousarray(frame.carry.transpose(2, 0, 1)[None], np.float32)
        shape = (1, planes.shape[1], *display_size[::-1])
        if past is not None and past.shape != shape:
            want = f"{past.shape[1]} channels as before, or a reset"
            raise FrameError("carry", got=f"{planes.shape[1]} channels", want=want)
        inputs = {
            "carry": planes,
            "depth": np.ascontiguousarray(frame.depth[None, None], np.float32),
            "motion": np.ascontiguousarray(frame.motion.transpose(2, 0, 1)[None], np.float32),
            "jitter": np.array([frame.jitter], np.float32),
            "display_size": np.array(display_size, np.int64),
            "weight": weight if past is not None else np.zeros_like(weight),
            "history.carry": np.zeros(shape, np.float32) if past is None else past,
        }
        image: Float32 = self._loaded().run(["image"], inputs)[0]
        return image

    def _loaded(self) -> ort.InferenceSession:
        with self._lock:
            if self._session is None:
                try:
                    providers = ["CPUExecutionProvider"]
                    self._session = ort.InferenceSession(str(self._path), self._options, providers=providers)
                except Exception as error:  # ONNX Runtime's own exceptions share no base but this one
                    raise ModelError(f"{self._path}: ONNX Runtime cannot load it: {error}") from error
            return self._session
