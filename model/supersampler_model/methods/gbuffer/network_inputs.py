"""The network inputs of `gbuffer`: surfaces, this frame, and two previous frames, masked (III.C)."""

import torch
from torch import Tensor

from supersampler_model.methods.gbuffer.buffers import CurrentFrame, History, WarpedHistory
from supersampler_model.methods.gbuffer.network import NetworkInputs
from supersampler_model.methods.gbuffer.surfaces import (
    Nearest,
    closest_around,
    gradients,
    occluded,
    read_bilinear,
    read_nearest,
    relative_depth,
)
from supersampler_model.ops.color import sanitize, tone

LONG = 8.0  # render pixels per unit of the motion inputs


def network_inputs(
    current: CurrentFrame, warped: WarpedHistory, before: Nearest, history: History, *, masked: bool
) -> NetworkInputs:
    """Compute the network inputs.

    Args:
        current: this frame.
        warped: the warped history at display size.
        before: samples of the previous frame, nearest to where the motion points.
        history: the history tensors.
        masked: see `GBufferConfig`.
    """
    motion, view, display = current.motion, current.view, current.display
    depth = relative_depth(current.render.depth, closest_around(current.render.depth))
    jitter = view.jitter[:, :, None, None].expand_as(motion)
    display_depth = relative_depth(display.depth, closest_around(display.depth))
    twice = motion + read_bilinear(history.motion, motion, view.jitter - history.jitter)
    last = _warped(current, before, motion, masked=masked)
    earlier_nearest = read_nearest(history.frame_before, twice, view.jitter - history.jitter_before)
    earlier = _warped(current, earlier_nearest, twice, masked=masked)
    return NetworkInputs(
        surfaces=torch.cat([*display[:5], display_depth], dim=1),
        gradients=gradients(display),
        current=torch.cat([current.toned, depth, jitter], dim=1),
        previous=last[0],
        refiner_inputs=last[1],
        earlier=earlier[0],
        earlier_refiner_inputs=earlier[1],
        samples=torch.cat([_short(motion), jitter, current.usable, depth], dim=1),
        colors=torch.cat(
            [
                current.guided,
                current.near - current.guided,
                warped.color - current.guided,
                warped.relit - current.guided,
                warped.counted / (warped.counted + 4.0),
                warped.surface,
                current.samples.likeness.clamp(max=1.0),
            ],
            dim=1,
        ),
    )


def _warped(
    current: CurrentFrame, nearest: Nearest, motion: Tensor, *, masked: bool
) -> tuple[Tensor, Tensor]:
    """Return a previous frame, warped and masked (equations 3 and 4), and the refiner's inputs beside it.

    Args:
        current: this frame.
        nearest: samples of the previous frame.
        motion: (1, 2, h, w) that points to them.
        masked: whether occluded samples are masked.
    """
    render, jitter = current.render, current.view.jitter
    found, offset, on_screen = nearest
    color, previous_depth, base, normal, usable = found.split_with_sizes([3, 1, 3, 3, 1], dim=1)
    toned = tone(sanitize(color, 0.0) * current.exposure)
    kept = on_screen * usable
    if masked:
        now = (current.toned, render.base_color, render.depth)
        kept = kept * (1.0 - occluded(now, (toned, base, previous_depth)))
    closest = closest_around(render.depth)
    depth, previous_depth = (
        relative_depth(render.depth, closest),
        relative_depth(previous_depth, closest) * kept,
    )
    place = offset + jitter[:, :, None, None]  # position of the sample relative to the pixel
    refiner_inputs = [_short(motion), render.base_color, render.normal, depth, render.roughness]
    refiner_inputs += [torch.cat([base, normal], dim=1) * kept, 1.0 - kept, previous_depth]
    return torch.cat([toned * kept, previous_depth, place * kept], dim=1), torch.cat(refiner_inputs, dim=1)


def _short(motion: Tensor) -> Tensor:
    return (motion / LONG).clamp(-4.0, 4.0)
