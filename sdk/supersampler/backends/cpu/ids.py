"""Ids at display size: `ss_resample_ids` of the CPU library, for steps of any backend."""

from collections.abc import Sequence
from ctypes import c_void_p
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.library import IdData, cpu_library, view_of
from supersampler.frame import Float32, Frame, Size

UInt32 = NDArray[np.uint32]


class IdHistory(NamedTuple):
    """Ids at display size.

    Attributes:
        ids: (H, W, k).
        distance: (H, W) display pixels from each pixel's centre to the sample that its ids are from.
    """

    ids: UInt32
    distance: Float32


class IdRequest(NamedTuple):
    """Arguments of `resample_ids` for one view: a frame with ids, and the history, None after a cut."""

    frame: Frame
    display: Size
    history: IdHistory | None


def resample_ids(requests: Sequence[IdRequest], model: c_void_p | None) -> list[IdHistory]:
    """Resample the ids of several views to display size; see `ss_resample_ids`.

    Args:
        requests: one for each view.
        model: model in the library whose threads do the work; None uses only the calling thread.

    Raises:
        LibraryError: the CPU library cannot be loaded.
    """
    views, alive, results = (IdData * len(requests))(), [], []
    for place, (frame, display, history) in enumerate(requests):
        assert frame.ids is not None  # noqa: S101  # see `Model.check`
        channels = frame.ids.shape[2]
        result = IdHistory(
            np.empty((*display[::-1], channels), np.uint32), np.empty(display[::-1], np.float32)
        )
        arrays: dict[str, NDArray[Any]] = {
            # negative values wrap around
            "ids": np.ascontiguousarray(frame.ids).astype(np.uint32, copy=False),
            "depth": np.ascontiguousarray(frame.depth),
            "motion": np.ascontiguousarray(frame.motion, np.float32),
            "image": result.ids,
            "distance": result.distance,
        }
        if history is not None:
            arrays |= {"previous": history.ids, "previous_distance": history.distance}
        views[place] = view_of(IdData, frame, display, channels, arrays)
        alive.append(arrays)
        results.append(result)
    cpu_library().call("ss_resample_ids", model, views, len(requests))
    del alive  # kept alive while the library read it
    return results
