"""Motion of each sample to the next frame, for a backward run.

A renderer may give it as `Frame.motion_next`. Otherwise the next frame's motion, which points to this frame,
is scattered: each sample of the next frame was at a known position in this one. If several were at one pixel,
the one with the nearest depth is used. A pixel that none reached, because its surface is occluded or minified
in the next frame, takes the motion of the nearest pixels of its surface.
"""

from dataclasses import replace

import numpy as np

from supersampler.arguments import ieee_arithmetic
from supersampler.backends.cpu.library import ScatterData, cpu_library
from supersampler.frame import Float32, Frame


@ieee_arithmetic
def reversed_frame(frame: Frame, following: Frame | None) -> Frame:
    """Return a frame for a backward run.

    Args:
        frame: the frame.
        following: the next frame of the shot, which precedes `frame` in the run; None if the run starts here.
    """
    if following is None:
        return replace(frame, motion=np.zeros((*frame.depth.shape, 2), np.float32), reset=True)
    given = frame.motion_next
    motion = scattered_motion(frame, following) if given is None else np.asarray(given, np.float32)
    return replace(frame, motion=motion, reset=False)


def scattered_motion(frame: Frame, following: Frame) -> Float32:
    """Return `frame.motion_next`, (h, w, 2) float32, computed from the motion of the next frame.

    The frames may have different render sizes.
    """
    depth, next_depth, next_motion = (
        np.ascontiguousarray(array, np.float32) for array in (frame.depth, following.depth, following.motion)
    )
    motion, mismatch = np.empty((*depth.shape, 2), np.float32), np.empty(depth.shape, np.float32)
    frames = ScatterData(*frame.size, *following.size)
    for name, array in (("depth", depth), ("next_depth", next_depth), ("next_motion", next_motion)):
        setattr(frames, name, array.ctypes.data)
    frames.jitter[:], frames.next_jitter[:] = frame.jitter, following.jitter
    cpu_library().call("ss_scatter_motion", frames, motion.ctypes.data, mismatch.ctypes.data)
    return motion
