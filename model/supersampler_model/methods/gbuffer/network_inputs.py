"""What the network of `gbuffer` sees: surfaces, this frame, and two of the past, masked (III.C)."""

import torch
from torch import Tensor

from supersampler_model.methods.gbuffer.buffers import History, Present, Remembered
from supersampler_model.methods.gbuffer.network import Seen
from supersampler_model.methods.gbuffer.surfaces import (
    Nearest,
    bilinear_past,
    closest_around,
    gradients,
    nearest_past,
    occluded,
    relative_depth,
)
from supersampler_model.ops.color import sanitize, tone

LONG = 8.0  # render pixels: motion is seen in these


def seen_of(present: Present, past: Remembered, before: Nearest, history: History, *, masked: bool) -> Seen:
    """Put together what is seen; of the past what may be of use alone, if `masked`.

    Args:
        present: this frame.
        past: the warped image of the frame before.
        before: that frame's own samples, read where the motion leads.
        history: what it left.
        masked: see GBufferConfig.
    """
    motion, view, display = present.motion, present.view, present.display
    depth = relative_depth(present.render.depth, closest_around(present.render.depth))
    jitter = view.jitter[:, :, None, None].expand_as(motion)
    display_depth = relative_depth(display.depth, closest_around(display.depth))
    twice = motion + bilinear_past(history.motion, motion, view.jitter - history.jitter)
    last = _warped(present, before, motion, masked=masked)
    long_ago = nearest_past(history.frame_before, twice, view.jitter - history.jitter_before)
    earlier = _warped(present, long_ago, twice, masked=masked)
    return Seen(
        surfaces=torch.cat([*display[:5], display_depth], dim=1),
        gradients=gradients(display),
        current=torch.cat([present.toned, depth, jitter], dim=1),
        past=last[0],
        beside=last[1],
        earlier=earlier[0],
        beside_earlier=earlier[1],
        samples=torch.cat([_short(motion), jitter, present.usable, depth], dim=1),
        colors=torch.cat(
            [
                present.guided,
                present.near - present.guided,
                past.color - present.guided,
                past.relit - present.guided,
                past.counted / (past.counted + 4.0),
                past.surface,
                present.samples.likeness.clamp(max=1.0),
            ],
            dim=1,
        ),
    )


def _warped(present: Present, nearest: Nearest, motion: Tensor, *, masked: bool) -> tuple[Tensor, Tensor]:
    """A frame of the past, warped and masked (equations 3 and 4), and what the refiner sees beside it.

    Args:
        present: this frame.
        nearest: samples of the past frame.
        motion: (1, 2, h, w) that led to them.
        masked: whether what is of no use is taken out.
    """
    render, jitter = present.render, present.view.jitter
    found, off, on_screen = nearest
    color, past_depth, base, normal, usable = found.split_with_sizes([3, 1, 3, 3, 1], dim=1)
    toned = tone(sanitize(color, 0.0) * present.exposure)
    kept = on_screen * usable
    if masked:
        now = (present.toned, render.base_color, render.depth)
        kept = kept * (1.0 - occluded(now, (toned, base, past_depth)))
    closest = closest_around(render.depth)
    depth, past_depth = relative_depth(render.depth, closest), relative_depth(past_depth, closest) * kept
    place = off + jitter[:, :, None, None]  # of the sample, in the pixel that it is read for
    beside = [_short(motion), render.base_color, render.normal, depth, render.roughness]
    beside += [torch.cat([base, normal], dim=1) * kept, 1.0 - kept, past_depth]
    return torch.cat([toned * kept, past_depth, place * kept], dim=1), torch.cat(beside, dim=1)


def _short(motion: Tensor) -> Tensor:
    return (motion / LONG).clamp(-4.0, 4.0)
