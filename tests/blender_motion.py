"""Motion of a rendered frame if nothing but the camera moved, from the recorded matrices."""

from supersampler.conventions import camera_motion, jittered_projection
from supersampler.frame import Float32
from supersampler.io.shot import Shot
from supersampler.io.shot.blender import RenderRecord


def camera_motion_of(shot: Shot, record: RenderRecord, index: int) -> Float32:
    """Return (h, w, 2) motion of a frame, as `Frame.motion` has it."""
    frames = [shot.read(index).frame, shot.read(index - 1).frame]
    matrices = [
        jittered_projection(record.frames[i].matrix, (-f.jitter[0], -f.jitter[1]), shot.render_size)
        for i, f in zip((index, index - 1), frames, strict=True)
    ]
    near = shot.conventions.near
    return camera_motion(
        frames[0].depth, *matrices, jitter=frames[0].jitter, near=near, clip="minus_one_to_one"
    )
