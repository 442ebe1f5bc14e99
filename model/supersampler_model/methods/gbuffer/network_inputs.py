"""The network inputs of `gbuffer`: surfaces, this frame, and two previous frames, masked (III.C)."""

import torch
from torch import Tensor

from supersampler_model.methods.gbuffer.buffers import CurrentFrame, History, WarpedHistory
from supersampler_model.methods.gbuffer.network import NetworkInputs
from supersampler_model.methods.gbuffer.surfaces import (
    NearestSamples,
    closest_around,
    gradients,
    occluded,
    read_bilinear,
    read_nearest,
    relative_depth,
)
from supersampler_model.ops.color import sanitize, tone

MOTION_UNIT = 8.0  # render pixels per unit of the motion inputs


def network_inputs(
    current: CurrentFrame, warped: WarpedHistory, before: NearestSamples, history: History, *, masked: bool
) -> NetworkInputs:
    """Compute the network inputs, in the type of the surfaces.

    Args:
        current: this frame.
        warped: the warped history at display size.
        before: samples of the previous frame, nearest to where the motion points.
        history: the history tensors.
        masked: see `GBufferConfig`.
    """
    _, motion, _, render, display, view = current.inputs
    dtype = display.base_color.dtype
    depth = relative_depth(render.depth, closest_around(render.depth))
    jitter = view.jitter[:, :, None, None].expand_as(motion)
    display_depth = relative_depth(display.depth, closest_around(display.depth))
    two_frames = motion + read_bilinear(history.motion, motion, view.jitter - history.jitter)
    previous, refiner_inputs = _warped(current, before, motion, masked=masked)
    earlier_samples = read_nearest(history.frame_before, two_frames, view.jitter - history.jitter_before)
    earlier, earlier_refiner_inputs = _warped(current, earlier_samples, two_frames, masked=masked)
    colors = [
        current.guided,
        current.near - current.guided,
        warped.color - current.guided,
        warped.relit - current.guided,
        warped.sample_count / (warped.sample_count + 4.0),
        warped.surface,
        current.samples.similarity.clamp(max=1.0),
    ]
    return NetworkInputs(
        surfaces=torch.cat([*display[:5], display_depth.to(dtype)], dim=1),
        gradients=gradients(display),
        current=torch.cat([current.toned, depth, jitter], dim=1).to(dtype),
        previous=previous,
        refiner_inputs=refiner_inputs,
        earlier=earlier,
        earlier_refiner_inputs=earlier_refiner_inputs,
        samples=torch.cat([_scaled(motion), jitter, current.usable, depth], dim=1).to(dtype),
        colors=torch.cat([color.to(dtype) for color in colors], dim=1),
    )


def _warped(
    current: CurrentFrame, nearest: NearestSamples, motion: Tensor, *, masked: bool
) -> tuple[Tensor, Tensor]:
    """Return a previous frame, warped and masked (equations 3 and 4), and its inputs of the refiner.

    Args:
        current: this frame.
        nearest: samples of the previous frame.
        motion: (1, 2, h, w) that points to them.
        masked: whether occluded samples are masked.
    """
    render, jitter = current.inputs.render, current.inputs.view.jitter
    dtype = render.base_color.dtype
    color, previous_depth, base, normal, usable = nearest.values.split_with_sizes([3, 1, 3, 3, 1], dim=1)
    base, normal = base.to(dtype), normal.to(dtype)
    toned = tone(sanitize(color, 0.0) * current.inputs.exposure)
    kept = nearest.on_screen * usable
    if masked:
        now = (current.toned.to(dtype), render.base_color, render.depth)
        kept = kept * (1.0 - occluded(now, (toned.to(dtype), base, previous_depth)))
    closest = closest_around(render.depth)
    depth = relative_depth(render.depth, closest)
    previous_depth = relative_depth(previous_depth, closest) * kept
    place = nearest.offset + jitter[:, :, None, None]  # of the sample, from the pixel's centre
    refiner_inputs = [_scaled(motion), render.base_color, render.normal, depth, render.roughness]
    refiner_inputs += [torch.cat([base, normal], dim=1) * kept, 1.0 - kept, previous_depth]
    features = torch.cat([toned * kept, previous_depth, place * kept], dim=1)
    return features.to(dtype), torch.cat([part.to(dtype) for part in refiner_inputs], dim=1)


def _scaled(motion: Tensor) -> Tensor:
    return (motion / MOTION_UNIT).clamp(-4.0, 4.0)
