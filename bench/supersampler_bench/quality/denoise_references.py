"""References of a path tracer's frames: found by a pattern, averaged, denoised, with their missing pixels."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from supersampler.denoising.oidn import FrameDenoiser
from supersampler.errors import ArgumentError, ShotError
from supersampler.frame import Float32
from supersampler.io.images import read_exr
from supersampler_bench.quality.metrics import Bool
from supersampler_bench.quality.scores import BORDER

DEFAULT_PATTERN = "{scene}-reference*/*.exr"
_LAST_NUMBER = re.compile(r".*?(\d+)\D*", re.DOTALL)


@dataclass(frozen=True)
class Reference:
    """The reference of a frame.

    Attributes:
        color: (h, w, 3) linear RGB; 0 where it is missing.
        scored: (h, w), True at pixels that are farther than BORDER from missing ones and from the edge.
        is_denoised: whether it was denoised, by itself.
    """

    color: Float32
    scored: Bool
    is_denoised: bool


def find_references(render: Path, scene: str, pattern: str) -> dict[int, list[Path]]:
    """Return the files of each frame's reference, by the frame's number, in order.

    Args:
        render: folder of the frames.
        scene: name that takes the place of `{scene}` in the pattern.
        pattern: pattern of files, relative to the folder that holds `render`. The last number of a file's
            name is that of its frame. Several files of one frame are averaged.

    Raises:
        ArgumentError: no file matches.
    """
    whole = Path.cwd() / render.parent / pattern.replace("{scene}", re.sub(r"([*?[])", r"[\1]", scene))
    found: dict[int, list[Path]] = {}
    for path in sorted(Path(whole.anchor).glob(str(whole.relative_to(whole.anchor)))):
        number = _LAST_NUMBER.fullmatch(path.stem)
        if number is not None and not path.name.startswith("."):
            found.setdefault(int(number[1]), []).append(path)
    if not found:
        hint = "State where the references are: --reference 'references/{scene}/*.exr'."
        raise ArgumentError("--reference", got=f"no file {whole}", want="files with frame numbers", hint=hint)
    return dict(sorted(found.items()))


def read_reference(files: Sequence[Path], denoiser: FrameDenoiser | None) -> Reference:
    """Return the mean of files, denoised where they have albedo and normal.

    A pixel is missing where a file has NaN, or 0 in colour and alpha: renderers leave so what lies outside of
    a rendered region.

    Args:
        files: EXR files with R, G, B, or with Blender's Combined, Denoising Albedo and Denoising Normal.
        denoiser: denoises the smallest rectangle around what is not missing; None denoises nothing.

    Raises:
        ShotError: a file cannot be read, has no colour, is empty, or differs in size from the first.
    """
    layers = [_read(path) for path in files]
    first = layers[0][1]
    for path, (_, found) in zip(files, layers, strict=True):
        if found.shape != first.shape:
            raise ShotError(path, f"has {found.shape} pixels; {files[0]} has {first.shape}")
    known = np.asarray(np.logical_and.reduce([found for _, found in layers]), bool)
    if not known.any():
        raise ShotError(files[0], "has no pixel that is known in all references of the frame")
    names = set.intersection(*({*images} for images, _ in layers))
    means = {name: np.mean([images[name] for images, _ in layers], axis=0) for name in names}
    is_denoised = denoiser is not None and {"albedo", "normal"} <= means.keys()
    color = means["color"]
    if denoiser is not None and is_denoised:
        box = bounding_box(known)
        color[box] = denoiser.denoise(color[box], means["albedo"][box], means["normal"][box])[0]
    color[~known] = 0.0
    return Reference(color, _without_border(known), is_denoised)


def bounding_box(mask: Bool) -> tuple[slice, slice]:
    """Return rows and columns of the smallest rectangle around the True pixels; there must be some."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def _read(path: Path) -> tuple[dict[str, Float32], Bool]:
    """Return a file's colour, and albedo and normal where it has them; and which pixels are known, (h, w)."""
    channels = read_exr(path, outside={})
    begin = next((name[:-1] for name in channels if name == "R" or name.endswith(".Combined.R")), None)
    if begin is None:
        raise ShotError(path, f"has no colour; it has {', '.join(channels)}", "It needs R, G, B or Combined.")
    layer = begin.removesuffix("Combined.")
    groups = {
        "color": [f"{begin}{axis}" for axis in "RGB"],
        "albedo": [f"{layer}Denoising Albedo.{axis}" for axis in "RGB"],
        "normal": [f"{layer}Denoising Normal.{axis}" for axis in "XYZ"],
    }
    found = {
        ours: np.stack([channels[name] for name in names], axis=-1).astype(np.float32)
        for ours, names in groups.items()
        if channels.keys() >= {*names}
    }
    known: Bool = np.asarray(np.isfinite(found["color"]).all(axis=-1))
    alpha = channels.get(f"{begin}A")
    if alpha is not None:
        known &= (found["color"] != 0.0).any(axis=-1) | (alpha != 0.0)
    return {name: np.nan_to_num(image) for name, image in found.items()}, known


def _without_border(known: Bool) -> Bool:
    """Return the pixels that have no missing pixel, and no edge of the image, within BORDER pixels."""
    side = 2 * BORDER + 1
    missing: Bool = np.pad(~known, BORDER, constant_values=True)
    for axis in (0, 1):
        missing = np.asarray(np.lib.stride_tricks.sliding_window_view(missing, side, axis).any(axis=-1))
    return np.asarray(~missing)


def check_scored(references: Mapping[int, Reference], files: Mapping[int, Sequence[Path]]) -> None:
    """Raise ShotError where a reference has no pixel to score."""
    for number, reference in references.items():
        if not reference.scored.any():
            problem = f"has no pixel that is {BORDER} pixels from missing ones and from the edge"
            raise ShotError(files[number][0], problem, "Render a larger region.")
