"""`ImageOptions`: names, formats and encodings of the images of a run, and the writing of one frame."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from supersampler.cli.run_record import FORMATS, NAME, frame_path
from supersampler.errors import ArgumentError
from supersampler.frame import Float32
from supersampler.io.display import to_uint8, to_uint16
from supersampler.io.display_transforms import DEFAULT_TRANSFORM, REC709, DisplayTransform
from supersampler.io.images import (
    Bytes,
    Metadata,
    half_pixels,
    pixel_aspect,
    write_exr,
    write_png,
    write_tiff,
)
from supersampler.io.shot.format import COLOR, aov_channels

_VIDEO = "mp4"
_LEAST_ALPHA = 0.5 / 65535.0  # less is written as 0


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputImage:
    """The image of one frame, and what is written beside its colour.

    Attributes:
        image: (H, W, 3) linear RGB.
        exposure: > 0, of what is shown.
        aovs: (H, W, k) AOVs for the EXR; PNG and TIFF have the one that is called A, alpha.
        aov_names: of their channels; None: A for k = 1, else aovs.0, aovs.1 and so on.
        metadata: entries of the header: of EXR all, of PNG and TIFF the pixel aspect ratio.
    """

    image: Float32
    exposure: float
    aovs: Float32 | None = None
    aov_names: Sequence[str] | None = None
    metadata: Metadata | None = None

    @property
    def aov_channels(self) -> list[str]:
        """Names of the AOVs' channels."""
        count = 0 if self.aovs is None else self.aovs.shape[2]
        return list(self.aov_names or (["A"] if count == 1 else aov_channels(count)))

    @property
    def alpha(self) -> Float32 | None:
        """(H, W, 1) alpha in [0, 1]; None where no AOV is called A."""
        if self.aovs is None or "A" not in self.aov_channels:
            return None
        at = self.aov_channels.index("A")
        alpha: Float32 = np.nan_to_num(self.aovs[..., at : at + 1]).clip(0.0, 1.0)
        return alpha


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageOptions:
    """Names, formats and encodings of the images of a run.

    Attributes:
        formats: "exr", "png", "tif"; with several, each has a subfolder of its name.
        video: whether an mp4 file is written, too.
        name: names of the images without extension; a run of # is the frame's number, with as many digits at
            least.
        transform: what PNG, TIFF and video show.
        compression: of EXR: "zip", "dwaa", "piz" or "none".
        bits: of PNG: 8 or 16. TIFF has 16.
        straight_alpha: whether colour is not multiplied by alpha, as in PNG and TIFF; in EXR it is.
        color_space: of the linear light; EXR files state it. None: not known, they have what the source says.

    Raises:
        ArgumentError: the name cannot be one of files.
    """

    formats: Sequence[str] = ("exr",)
    video: bool = False
    name: str = "####"
    transform: DisplayTransform = DEFAULT_TRANSFORM
    compression: str = "zip"
    bits: int = 8
    straight_alpha: bool = False
    color_space: str | None = REC709

    @property
    def patterns(self) -> list[str]:
        """Patterns of the files of each format, as upscale.json lists them."""
        return [f"{self.below(name)}{self.name}.{name}" for name in self.formats]

    def below(self, extension: str) -> str:
        """Return the subfolder of a format, "png/", or "" where there is none."""
        return f"{extension}/" if len(self.formats) > 1 else ""

    def to_json(self) -> dict[str, object]:
        """Return all that the files depend on, as JSON."""
        return {
            "formats": list(self.formats),
            "name": self.name,
            "compression": self.compression if "exr" in self.formats else None,
            "bits": self.bits if "png" in self.formats else None,
            "color space": self.color_space,
            "display transform": self.transform.to_json(),
        }

    def write(self, folder: Path, number: int, output: OutputImage, below: str = "") -> Bytes | None:
        """Write the files of one frame, each atomically; several threads may write different frames.

        Args:
            folder: of the run.
            number: of the frame.
            output: its image.
            below: subfolder of the folder, such as "recorded/".

        Returns:
            (H, W, 3) uint8, the image of the video; None where there is none.

        Raises:
            ShotError: the disk refused.
        """
        encoding, aspect = self.transform.encoding, pixel_aspect(output.metadata or {})
        shown = self._shown_with_alpha(output) if {"png", "tif"}.intersection(self.formats) else None
        for pattern in self.patterns:
            path = frame_path(folder, f"{below}{pattern}", number)
            if shown is not None and path.suffix == ".png":
                write_png(path, to_uint8(shown) if self.bits == 8 else to_uint16(shown), encoding, aspect)
            elif shown is not None and path.suffix == ".tif":
                write_tiff(path, to_uint16(shown), encoding, aspect)
            else:
                self._write_exr(path, output)
        if not self.video:
            return None
        if shown is None or shown.shape[2] == 4:  # a video has no alpha: it shows the image over black
            shown = self.transform.show(output.image, output.exposure)
        return to_uint8(shown)

    def _shown_with_alpha(self, output: OutputImage) -> Float32:
        """Return (H, W, 3) as a display shows it, or (H, W, 4) with alpha that it is not multiplied by."""
        alpha = output.alpha
        if alpha is None:
            return self.transform.show(output.image, output.exposure)
        image = output.image
        if not self.straight_alpha:  # colour without coverage, such as a glow, stays as it is
            image = np.divide(image, alpha, out=image.copy(), where=alpha > _LEAST_ALPHA)
        return np.concatenate([self.transform.show(image, output.exposure), alpha], axis=2)

    def _write_exr(self, path: Path, output: OutputImage) -> None:
        names, arrays = list(COLOR), [output.image]
        if output.aovs is not None:
            names += output.aov_channels
            arrays.append(output.aovs)
        write_exr(
            path,
            half_pixels(arrays),
            names,
            compression=self.compression,
            metadata=output.metadata,
            color_space=self.color_space,
        )


def image_options(
    formats: Iterable[str],
    *,
    name: str = "####",
    transform: DisplayTransform = DEFAULT_TRANSFORM,
    compression: str = "zip",
    bits: int = 8,
    straight_alpha: bool = False,
    color_space: str | None = REC709,
) -> ImageOptions:
    """Return the options of formats, "mp4" among them."""
    chosen = set(formats)
    return ImageOptions(
        formats=tuple(sorted(chosen - {_VIDEO})),
        video=_VIDEO in chosen,
        name=name,
        transform=transform,
        compression=compression,
        bits=bits,
        straight_alpha=straight_alpha,
        color_space=color_space,
    )


def checked_name(name: str) -> str:
    """Return the value of --name; ArgumentError where files cannot have it."""
    if NAME.fullmatch(name) is None or Path(name).suffix[1:] in FORMATS:
        want = "a file name without extension, with one run of # for the number, such as beauty.####"
        raise ArgumentError("--name", got=repr(name), want=want)
    return name
