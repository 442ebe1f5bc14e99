"""References of a path tracer's frames: found by a pattern, averaged, denoised, with their missing pixels."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from supersampler.denoising.oidn import FrameDenoiser
from supersampler.errors import ArgumentError, ShotError
from supersampler.frame import Float32
from supersampler.io.images import read_exr
from supersampler_bench.quality.masks import dilated
from supersampler_bench.quality.metrics import Bool
from supersampler_bench.quality.scores import BORDER

_LAST_NUMBER = re.compile(r".*?(\d+)\D*", re.DOTALL)


@dataclass(frozen=True)
class Reference:
    """The reference of a frame."""

    color: Float32  # (h, w, 3) linear RGB; 0 where it is missing
    scored: Bool  # (h, w), pixels farther than BORDER from missing ones and from the edge
    is_denoised: bool


def find_references(render: Path, scene: str, pattern: str) -> dict[int, list[Path]]:
    """Return the files of each frame's reference, in order, by the frame's number.

    The pattern is relative to the folder that holds `render`, the folder of the frames; `{scene}` stands for
    the scene. The last number in the name of a file is the number of its frame.

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
        hint = "Pass their pattern: --reference 'references/{scene}/*.exr'."
        raise ArgumentError("--reference", got=f"no file {whole}", want="files with frame numbers", hint=hint)
    return dict(sorted(found.items()))


def read_reference(files: Sequence[Path], denoiser: FrameDenoiser | None) -> Reference:
    """Return the mean of EXR files; the denoiser denoises it if they have albedo and normal.

    The files have R, G, B, or Blender's Combined, Denoising Albedo and Denoising Normal. A pixel is missing
    where a file has NaN, or 0 in colour and alpha, as renderers write outside of a rendered region.

    Raises:
        ShotError: a file cannot be read, has no colour, is empty, or differs in size from the first.
    """
    images, masks = zip(*map(_read, files), strict=True)
    for path, found in zip(files, masks, strict=True):
        if found.shape != masks[0].shape:
            raise ShotError(path, f"has {found.shape} pixels; {files[0]} has {masks[0].shape}")
    known = np.asarray(np.logical_and.reduce(masks), bool)
    if not known.any():
        raise ShotError(files[0], "has no pixel that is known in all references of the frame")
    names = set.intersection(*map(set, images))
    means = {name: np.mean([image[name] for image in images], axis=0) for name in names}
    is_denoised = denoiser is not None and {"albedo", "normal"} <= means.keys()
    color = means["color"]
    if denoiser is not None and is_denoised:
        box = bounding_box(known)
        guides = denoiser.clean_guides(means["albedo"][box], means["normal"][box])
        color[box] = denoiser.denoise(color[box], *guides)
    color[~known] = 0.0
    return Reference(color, ~dilated(~known, BORDER, edge=True), is_denoised)


def bounding_box(mask: Bool) -> tuple[slice, slice]:
    """Return the rows and columns of the smallest rectangle around the True pixels."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def _read(path: Path) -> tuple[dict[str, Float32], Bool]:
    """Return colour, and albedo and normal if the file has them, and the mask (h, w) of known pixels."""
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
