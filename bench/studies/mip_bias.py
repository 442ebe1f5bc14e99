"""Whether pixels show a missing mip bias: statistics of sequences rendered with it and without.

    python bench/studies/mip_bias.py --gltf FOLDER

Each statistic gets the threshold that no correct sequence of even seeds passes; hits and false alarms are
those of odd seeds. Sequences are pairs of frames of 320x180 pixels; blocks are parts of one smooth surface.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.conventions import Conventions, halton_jitter, mip_bias
from supersampler.validation.evidence import Evidence, luminance
from supersampler.validation.reprojection import FramePair, frame_pairs
from supersampler_model.data.renderer import renderer as renderer_module
from supersampler_model.data.renderer.context import open_graphics
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.scenes.gltf.compose import compose
from supersampler_model.data.sequences import APART_FAMILIES, TEST_FAMILIES, TRAIN_FAMILIES, make_sequence
from supersampler_model.data.specs import Sequence, SequenceSpec

Values = NDArray[np.float64]

SIZE = (320, 180)
RATIOS = (1.5, 2.0, 3.0)
FRAMES = 3
SIDE, STEP, RIM = 16, 12, 4  # render pixels: of a block, between blocks, and outside of them
MIN_CONTRAST = 4e-4  # mean squared change of tone-mapped luminance over two pixels
MIN_FINE = 0.35  # of that change, already over one pixel: less is too smooth to show a bias
MIN_BLOCKS = 40
STATISTICS = ("D(1) / D(2)", "D(1) D(4) / D(2)^2", "residual / D(1)", "residual / D(1), 80 % of blocks")


def frames_of(sequence: Sequence, renderer: Renderer, bias: float) -> list[Evidence]:
    """Render the first frames with a mip bias; the first jitters are those of every ratio."""
    found = []
    for index in range(FRAMES):
        jitter = halton_jitter(index, 2.0)
        renderer_module.mip_bias = lambda *_: bias  # type: ignore[attr-defined]
        color, surfaces = renderer.frame(sequence.scene(index), SIZE, jitter=jitter)
        motion = surfaces.motion.astype(np.float16)
        found.append(Evidence(luminance(color), surfaces.depth, motion, jitter, index == 0))
    return found


def lanczos(fraction: Values) -> Values:
    """Return the weights (6, ...) of the pixels from 2 before to 3 after a position."""
    away = fraction - np.arange(-2, 4).reshape(-1, *[1] * fraction.ndim)
    weights = np.sinc(away) * np.sinc(away / 3)
    normalised: Values = weights / weights.sum(axis=0)
    return normalised


def blocks_of(pair: FramePair) -> Values:
    """Return (n, 4) of the textured blocks: D(1), D(2), D(4) and the residual.

    D(d) is the mean squared difference of pixels d apart; the residual is that of a pixel and the previous
    frame, interpolated where the pixel's sample was.
    """
    tone, before = pair.tone.astype(np.float64)[1:-1, 1:-1], pair.tone_before.astype(np.float64)[1:-1, 1:-1]
    depth, (height, width) = pair.now.depth.astype(np.float64), pair.now.depth.shape
    across = np.arange(SIDE) - (SIDE - 1) / 2
    plane = np.stack([np.ones((SIDE, SIDE)), across[:, None] + 0 * across, across + 0 * across[:, None]])
    basis = np.linalg.qr(plane.reshape(3, -1).T)[0]
    rows = []
    for top in range(RIM, height - SIDE - RIM, STEP):
        for left in range(RIM, width - SIDE - RIM, STEP):
            flat = depth[top : top + SIDE, left : left + SIDE].ravel()
            bend = np.abs(flat - basis @ (basis.T @ flat)).max()
            if not 0 <= bend < 0.02 * flat.mean():
                continue
            y, x = np.mgrid[top : top + SIDE, left : left + SIDE]
            offset = pair.offset(Conventions(), (y.ravel(), x.ravel())).reshape(SIDE, SIDE, 2)
            at_x, at_y = x + offset[..., 0], y + offset[..., 1]
            if not (min(at_x.min(), at_y.min()) >= 3 and at_x.max() < width - 4 and at_y.max() < height - 4):
                continue
            column, row = np.floor(at_x).astype(int), np.floor(at_y).astype(int)
            near = pair.before.depth[row, column].ravel()
            phase = (np.sin(np.pi * at_x) ** 2 + np.sin(np.pi * at_y) ** 2).mean()
            if phase < 0.4 or np.abs(near - flat).max() > 0.1 * flat.mean():
                continue
            rows.append(_measured(tone, before, (y, x), (row, column), (at_y - row, at_x - column)))
    measured = np.array(rows).reshape(-1, 4)
    textured = (measured[:, 1] > MIN_CONTRAST) & (measured[:, 0] > MIN_FINE * measured[:, 1])
    return measured[textured]


def _measured(tone: Values, before: Values, places: Any, corner: Any, fraction: Any) -> list[float]:
    (y, x), (row, column) = places, corner
    now = tone[y, x]
    changes = [
        float(((tone[y, x + d] - now) ** 2).mean() + ((tone[y + d, x] - now) ** 2).mean()) / 2
        for d in (1, 2, 4)
    ]
    taps = np.arange(-2, 4)
    read = before[row + taps.reshape(-1, 1, 1, 1), column + taps.reshape(-1, 1, 1)]
    predicted = np.einsum("ayx,byx,abyx->yx", lanczos(fraction[0]), lanczos(fraction[1]), read)
    return [*changes, float((predicted - now).var())]


def statistics_of(frames: list[Evidence]) -> Values | None:
    """Return log2 of each statistic, lower without bias; None with too few textured blocks."""
    blocks = np.concatenate([blocks_of(pair) for pair in frame_pairs(frames)])
    if len(blocks) < MIN_BLOCKS:
        return None
    one, two, four, residual = np.log2(blocks + 1e-12).T
    medians = [float(np.median(v)) for v in (one - two, one + four - 2 * two, residual - one)]
    return np.array([*medians, float(np.percentile(residual - one, 80))])


def main() -> None:
    """Render, measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--gltf", type=Path)
    parser.add_argument("--seeds", type=int, default=6)
    options = parser.parse_args()
    renderer = Renderer(SIZE, samples=1, graphics=open_graphics())
    families = (*TRAIN_FAMILIES, *TEST_FAMILIES, *APART_FAMILIES)
    found: dict[float, list[tuple[int, Values]]] = {ratio: [] for ratio in (1.0, *RATIOS)}
    for seed in range(100, 100 + options.seeds):
        drawn = [make_sequence(SequenceSpec(family=family, seed=seed, frames=5)) for family in families]
        if options.gltf is not None:
            drawn += [compose(options.gltf, 5 * (seed - 100) + i, 8) for i in range(1, 6)]
        for ratio in found:
            for sequence in drawn:
                values = statistics_of(frames_of(sequence, renderer, mip_bias(ratio, "log2")))
                if values is not None:
                    found[ratio].append((sequence.spec.seed, values))
    for index, name in enumerate(STATISTICS):
        for ratio in RATIOS:
            limit = min(values[index] for seed, values in found[ratio] if seed % 2 == 0)
            held = [
                np.array([v[index] < limit for seed, v in found[each] if seed % 2]) for each in (1.0, ratio)
            ]
            counts = (f"{each.sum()} of {len(each)}" for each in held)
            print(f"{name}, ratio {ratio:g}: {' hits, '.join(counts)} false alarms")


if __name__ == "__main__":
    main()
