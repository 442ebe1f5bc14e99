"""Fits the constants of the temporal filter to frames of a path tracer with references.

    python -m supersampler_model.denoising.training SHOT:SAMPLES...

prints `OF_DENOISED` of `supersampler.denoising.spec`. Some frames in a row of each SHOT have references;
SAMPLES are its samples per pixel. Open Image Denoise denoises shots that are not denoised yet. The filter
is fitted to gain in every shot over frames that are denoised one by one: in PSNR, in tPSNR, and in error as
people see it. A shot in which it would lose costs far more than the others gain.
"""

import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from supersampler import Shot
from supersampler.denoising import temporal
from supersampler.denoising.sequence import BUFFERS, TemporalDenoiser
from supersampler.denoising.spec import Weights
from supersampler.errors import ShotError
from supersampler.frame import Float32
from supersampler.io.display import ExposureMeter
from supersampler_model.denoising.filter import (
    TemporalFilter,
    WindowFrame,
    box,
    distances,
    gathered,
    relit,
    squared,
)

ROUNDS, LEARNING_RATE = 20, 0.08
MIN_CHANNEL = 1e-4
"""Minimum colour in the display curve, whose slope at 0 is infinite."""
GAINS = 1.0, 0.4, 6.0
"""Worth of a dB of PSNR, a dB of tPSNR, and of all visible error."""
LEAST_GAINS, LOSSES = (0.04, 0.02), (10.0, 300.0)
"""Least gains of each shot in PSNR and in visible error, and the costs of what is missing."""
DRIFT_COST = 0.02
"""Cost of the squared change of the logarithm of each cost: costs that do not matter keep their values."""


class Example(NamedTuple):
    """A frame with a reference, and its k neighbours."""

    own: Tensor  # (1, 3, h, w) linear RGB, denoised
    colors: Tensor  # (k, 3, h, w) of the neighbours, in the light of the frame
    distances: Tensor  # (k, len(COSTS), h, w)
    known: Tensor  # (k, 1, h, w)
    reference: Tensor  # (1, 3, h, w), 0 where it is not scored
    scored: Tensor  # (h, w) bool


class Render(NamedTuple):
    """Frames in a row of one shot."""

    examples: Sequence[Example]
    samples: float


def example_of(
    frame: WindowFrame,
    previous: Sequence[WindowFrame],
    following: Sequence[WindowFrame],
    reference: Tensor,
    samples: float,
    exposure: float = 1.0,
) -> Example:
    """Gather a frame's neighbours; `reference` is (1, 3, h, w), NaN in pixels to leave out."""
    others = [*gathered(frame, previous, "to_previous"), *gathered(frame, following, "to_next")]
    return Example(
        own=frame.color[:, :3],
        colors=torch.cat([relit(frame, other, exposure, samples) for other in others]),
        distances=torch.cat([distances(frame, other, exposure) for other in others]),
        known=torch.cat([other.known for other in others]),
        reference=reference.nan_to_num(),
        scored=~torch.isnan(reference[0]).any(dim=0),
    )


def displayed(color: Tensor) -> Tensor:
    """Return linear colour as sRGB values in [0, 1]."""
    clamped = color.clamp(0.0, 1.0)
    curve = 1.055 * clamped.clamp(min=MIN_CHANNEL) ** (1.0 / 2.4) - 0.055
    return torch.where(clamped <= 0.0031308, 12.92 * clamped, curve)


def blended(model: TemporalFilter, example: Example, samples: float) -> Tensor:
    """Return the filtered image, (1, 3, h, w)."""
    weights = model.weight(example.distances, samples) * example.known
    total = 1.0 + weights.sum(dim=0, keepdim=True)
    return (example.own + (weights * example.colors).sum(dim=0, keepdim=True)) / total


def visible(error: Tensor) -> Tensor:
    """Return the visible error of each pixel, (h, w), of a displayed error (1, 3, h, w).

    Like FLIP, it sees colour more coarsely than luminance, and little of fine noise.
    """
    luminance = error.mean(dim=1, keepdim=True)
    parts = squared(box(luminance, 1)) + squared(box(error - luminance, 3)) / 6.0 + squared(error) / 30.0
    return (parts[0, 0] + 1e-5) ** 0.35


def scores(images: Sequence[Tensor], examples: Sequence[Example]) -> Tensor:
    """Return PSNR, tPSNR (0 of a single frame), and minus the visible error; (3)."""
    errors = [displayed(image) - displayed(e.reference) for image, e in zip(images, examples, strict=True)]
    masks = [example.scored for example in examples]

    def decibels(error: Tensor, mask: Tensor) -> Tensor:
        return -10.0 * error.square().mean(dim=1)[0][mask].mean().log10()

    psnr = torch.stack([decibels(*pair) for pair in zip(errors, masks, strict=True)]).mean()
    changes = [
        decibels(after[0] - before[0], after[1] & before[1])
        for before, after in pairwise(zip(errors, masks, strict=True))
    ]
    tpsnr = torch.stack(changes).mean() if changes else torch.zeros(())
    seen = torch.stack(
        [visible(error)[mask].mean() for error, mask in zip(errors, masks, strict=True)]
    ).mean()
    return torch.stack([psnr, tpsnr, -seen])


def gains(model: TemporalFilter, render: Render) -> Tensor:
    """Return what the filter gains: dB of PSNR, dB of tPSNR, fraction of the visible error; (3)."""
    before = scores([example.own for example in render.examples], render.examples)
    images = [blended(model, example, render.samples) for example in render.examples]
    return (scores(images, render.examples) - before) / torch.stack([*torch.ones(2), -before[2]])


def fit(renders: Sequence[Render], *, rounds: int = ROUNDS) -> TemporalFilter:
    """Fit a filter to shots, each used once in a round."""
    model = TemporalFilter()
    start = model.log_costs.detach().clone()
    optimizer = torch.optim.Adam(model.parameters(), LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, rounds * len(renders))
    for render in (*renders,) * rounds:
        found = gains(model, render)
        missing = torch.relu(torch.tensor(LEAST_GAINS) - found[[0, 2]])
        drift = (model.log_costs - start).square().sum()
        optimizer.zero_grad()
        loss = (
            (missing * torch.tensor(LOSSES)).sum() - (found * torch.tensor(GAINS)).sum() + DRIFT_COST * drift
        )
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        schedule.step()
    return model


def constants(model: TemporalFilter) -> Weights:
    """Return a filter's constants, rounded as in `supersampler.denoising.spec`."""
    values = (model.log_weight.item(), *model.log_costs.exp().tolist())
    return Weights(*(round(value, 4) for value in values))


def render_of(shot: Shot, samples: float) -> Render:
    """Return the frames of a shot that have a reference of their size; a ShotError if there are none."""
    frames = [item.frame for item in shot.frames(gbuffers=BUFFERS, references=False)]
    with TemporalDenoiser(per_frame="none" if shot.is_denoised else "oidn") as denoiser:
        windows = [as_tensors(window) for window in denoiser.windows(frames)]
    examples = []
    for index in shot.reference_indices:
        reference = shot.read_reference(index)
        if reference is not None and reference.shape[:2] == frames[index].depth.shape:
            exposure = ExposureMeter().read_frame(frames[index])
            previous, following = windows[:index][::-1], windows[index + 1 :]
            ideal = planes(reference)
            examples.append(example_of(windows[index], previous, following, ideal, samples, exposure))
    if not examples:
        hint = "Render some of its frames with many samples."
        raise ShotError(shot.path, "no frame has a reference of its own size", hint)
    return Render(examples, samples)


def as_tensors(window: temporal.WindowFrame) -> WindowFrame:
    """Convert a frame of the CPU library's filter, without AOVs."""
    steps = [None if step is None else planes(step) for step in (window.to_previous, window.to_next)]
    albedo, normal = planes(window.guides[..., :3]), planes(window.guides[..., 4:7])
    return WindowFrame(planes(window.color), albedo, normal, *steps)


def planes(array: Float32) -> Tensor:
    """Return an array (h, w, c) as (1, c, h, w)."""
    return torch.from_numpy(np.ascontiguousarray(array, np.float32)).permute(2, 0, 1)[None]


def name_and_samples(text: str) -> tuple[str, float]:
    """Split an argument of the command line; ValueError if it does not end in a number."""
    name, _, samples = text.rpartition(":")
    return name, float(samples)


def main() -> None:
    """Fit to the shots of the command line."""
    parser = ArgumentParser(description="Fits the constants of the temporal filter.")
    help_text = "frames in a row, some with references"
    parser.add_argument("shots", nargs="+", type=name_and_samples, metavar="SHOT:SAMPLES", help=help_text)
    renders = [render_of(Shot.open(name), samples) for name, samples in parser.parse_args().shots]
    sys.stdout.write(f"{constants(fit(renders))}\n")


if __name__ == "__main__":
    main()
