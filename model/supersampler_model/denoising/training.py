"""Fits the constants of the temporal filter to frames of a path tracer with references.

    python -m supersampler_model.denoising.training [--hold NAME,...] SHOT...

prints the lines of `supersampler.denoising.spec`; constants that are held keep their values. Some frames of
each SHOT have references. Open Image Denoise denoises shots that are not denoised yet. The loss of a pixel is
its displayed error over the mean error of the unfiltered frame. An error in excess of the unfiltered pixel's
counts twice.
"""

import sys
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from supersampler import Shot
from supersampler.denoising import temporal
from supersampler.denoising.sequence import BUFFERS, TemporalDenoiser
from supersampler.frame import Float32
from supersampler.io.display import ExposureMeter
from supersampler_model.denoising.filter import COSTS, TemporalFilter, WindowFrame, distances, gathered

STEPS, BATCH, LEARNING_RATE = 800, 4096, 0.03
SMALL_ERROR = 0.02
"""Displayed error from which on the loss is linear, so that few bright pixels do not dominate."""
MIN_CHANNEL = 1e-4
"""Minimum colour in the display curve, whose slope at 0 is infinite."""


class Example(NamedTuple):
    """The n pixels of a frame with a reference, and their k neighbours."""

    own: Tensor  # (n, 3) linear RGB, denoised
    colors: Tensor  # (n, k, 3) of the neighbours
    distances: Tensor  # (n, k, len(COSTS))
    known: Tensor  # (n, k)
    reference: Tensor  # (n, 3)


def example_of(
    frame: WindowFrame,
    previous: Sequence[WindowFrame],
    following: Sequence[WindowFrame],
    reference: Tensor,
    exposure: float = 1.0,
) -> Example:
    """Gather a frame's neighbours; `reference` is (1, 3, h, w), NaN in pixels to leave out."""
    others = [*gathered(frame, previous, "to_previous"), *gathered(frame, following, "to_next")]
    kept = ~torch.isnan(reference[0, 0]).flatten()

    def pixels(image: Tensor) -> Tensor:
        return image[0].flatten(1).T[kept]

    return Example(
        own=pixels(frame.color[:, :3]),
        colors=torch.stack([pixels(other.color[:, :3]) for other in others], dim=1),
        distances=torch.stack([pixels(distances(frame, other, exposure)) for other in others], dim=1),
        known=torch.stack([pixels(other.known)[:, 0] for other in others], dim=1),
        reference=pixels(reference),
    )


def displayed(color: Tensor) -> Tensor:
    """Return linear colour as sRGB values in [0, 1]."""
    clamped = color.clamp(0.0, 1.0)
    curve = 1.055 * clamped.clamp(min=MIN_CHANNEL) ** (1.0 / 2.4) - 0.055
    return torch.where(clamped <= 0.0031308, 12.92 * clamped, curve)


def errors(color: Tensor, reference: Tensor) -> Tensor:
    """Return the displayed error of each pixel, (n,): squared where it is small, linear beyond."""
    difference = displayed(color) - displayed(reference)
    return ((difference * difference).mean(dim=1) + SMALL_ERROR**2).sqrt() - SMALL_ERROR


def blended(model: TemporalFilter, example: Example) -> Tensor:
    """Return the filtered pixels, (n, 3)."""
    weights = model.weight(example.distances) * example.known
    total = 1.0 + weights.sum(dim=1)
    return (example.own + (weights[..., None] * example.colors).sum(dim=1)) / total[:, None]


def fit(examples: Sequence[Example], *, held: Sequence[str] = (), steps: int = STEPS) -> TemporalFilter:
    """Fit a filter to examples, each used equally often; the costs in `held` keep their values."""
    torch.manual_seed(0)
    model = TemporalFilter()
    is_free = torch.tensor([name not in held for name in COSTS])
    model.log_costs.register_hook(lambda gradient: gradient * is_free)  # type: ignore[no-untyped-call]
    scales = [float(errors(example.own, example.reference).mean()) for example in examples]
    optimizer = torch.optim.Adam(model.parameters(), LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    for step in range(steps):
        at = step % len(examples)
        pixels = torch.randint(len(examples[at].own), (BATCH,))
        batch = Example(*(values[pixels].float() for values in examples[at]))
        error = errors(blended(model, batch), batch.reference)
        worse = torch.relu(error - errors(batch.own, batch.reference))
        optimizer.zero_grad()
        ((error + worse).mean() / scales[at]).backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        schedule.step()
    return model


def constants(model: TemporalFilter) -> list[str]:
    """Return a filter's constants as lines of `supersampler.denoising.spec`."""
    costs = zip(COSTS, model.log_costs.exp().tolist(), strict=True)
    return [f"LOG_WEIGHT = {model.log_weight.item():.4f}", *(f"{name} = {cost:.4f}" for name, cost in costs)]


def examples_of(shot: Shot) -> Iterator[Example]:
    """Yield an example for each frame of a shot that has a reference of its size."""
    frames = [item.frame for item in shot.frames(gbuffers=BUFFERS, references=False)]
    with TemporalDenoiser(per_frame="none" if shot.is_denoised else "oidn") as denoiser:
        windows = [as_tensors(window) for window in denoiser.windows(frames)]
    for index in shot.reference_indices:
        reference = shot.read_reference(index)
        if reference is not None and reference.shape[:2] == frames[index].depth.shape:
            exposure = ExposureMeter().read_frame(frames[index])
            previous, following = windows[:index][::-1], windows[index + 1 :]
            yield example_of(windows[index], previous, following, planes(reference), exposure)


def as_tensors(window: temporal.WindowFrame) -> WindowFrame:
    """Convert a frame of the CPU library's filter, without AOVs."""
    steps = [None if step is None else planes(step) for step in (window.to_previous, window.to_next)]
    albedo, normal = planes(window.guides[..., :3]), planes(window.guides[..., 4:7])
    return WindowFrame(planes(window.color), albedo, normal, *steps)


def planes(array: Float32) -> Tensor:
    """Return an array (h, w, c) as (1, c, h, w)."""
    return torch.from_numpy(np.ascontiguousarray(array, np.float32)).permute(2, 0, 1)[None]


def main() -> None:
    """Fit to the shots of the command line."""
    parser = ArgumentParser(description="Fits the constants of the temporal filter.")
    parser.add_argument("--hold", default="", metavar="NAME,...", help="costs that keep their values")
    parser.add_argument("shots", nargs="+", metavar="SHOT", help="frames, some with references")
    options = parser.parse_args()
    examples = [example for name in options.shots for example in examples_of(Shot.open(name))]
    sys.stdout.write("\n".join(constants(fit(examples, held=options.hold.split(",")))) + "\n")


if __name__ == "__main__":
    main()
