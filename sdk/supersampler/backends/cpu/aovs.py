"""AOVs at display size: `ss_blend_aovs` of the CPU library."""

from collections.abc import Sequence
from ctypes import c_void_p
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.base import AovRequest
from supersampler.backends.cpu.library import AovData, cpu_library
from supersampler.frame import Float32


def blend_aovs(requests: Sequence[AovRequest], model: c_void_p) -> list[Float32]:
    """Upsample the AOVs of several views to display size, and blend them with their history.

    Args:
        requests: one for each view.
        model: model in the library whose threads do the work.

    Returns:
        (1, k, H, W) of each view, whose channels of a pixel lie next to each other in memory.
    """
    views, alive, results = (AovData * len(requests))(), [], []
    for place, (frame, display, weight, history) in enumerate(requests):
        given = np.ascontiguousarray(frame.aovs, np.float32)
        image = np.empty((*display[::-1], given.shape[2]), np.float32)
        arrays: dict[str, NDArray[Any]] = {
            "aovs": given,
            "depth": np.ascontiguousarray(frame.depth),
            "motion": np.ascontiguousarray(frame.motion, np.float32),
            "image": image,
        }
        if weight is not None:
            arrays["weight"] = weight
        if history is not None:
            arrays["previous"] = np.ascontiguousarray(history[0].transpose(1, 2, 0))
        data = AovData(*frame.size, *display, given.shape[2])
        data.jitter[:] = frame.jitter
        for name, array in arrays.items():
            setattr(data, name, array.ctypes.data)
        views[place] = data
        alive.append(arrays)
        results.append(image.transpose(2, 0, 1)[None])
    cpu_library().call("ss_blend_aovs", model, views, len(requests))
    del alive  # kept alive while the library read it
    return results
