"""`Oidn`: Intel Open Image Denoise, which denoises single images, from the package pyoidn."""

from collections.abc import Mapping
from importlib.util import find_spec
from typing import Any, Protocol, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from supersampler.errors import SupersamplerError
from supersampler.frame import Float32

Guides: TypeAlias = tuple[Float32 | None, Float32 | None]
"""Albedo and normal of a frame, (h, w, 3) each; None where it has none."""


class FrameDenoiser(Protocol):
    """Denoises one frame."""

    def clean_guides(self, albedo: Float32 | None, normal: Float32 | None) -> Guides:
        """Return albedo and normal, (h, w, 3) each, without noise; a guide that is None stays None."""

    def denoise(self, color: Float32, albedo: Float32 | None, normal: Float32 | None) -> Float32:
        """Return colour (h, w, 3) without noise; the guides are those of `clean_guides`."""


def has_oidn() -> bool:
    """Return whether pyoidn is installed."""
    return find_spec("pyoidn") is not None


class Oidn:
    """Open Image Denoise on the CPU; one thread at a time may use it.

    Albedo and normal must be denoised first, by `clean_guides`: at few samples they are as noisy as colour
    (Cycles calls this the prefilter ACCURATE).

    Args:
        threads: threads of OIDN; 0 is one per core.

    Raises:
        ModuleNotFoundError: pyoidn is not installed: `pip install "supersampler[denoise]"`.
        SupersamplerError: OIDN cannot run on this machine.
    """

    def __init__(self, threads: int = 0) -> None:
        import pyoidn

        self._library: Any = pyoidn
        self._device = pyoidn.Device(pyoidn.OIDN_DEVICE_TYPE_CPU)
        if threads:
            self._device.set_int("numThreads", threads)
        self._device.commit()
        self._check()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._device.release()

    def clean_guides(self, albedo: Float32 | None, normal: Float32 | None) -> Guides:
        """Return albedo and normal, (h, w, 3) each, without noise; a guide that is None stays None."""
        return (
            None if albedo is None else self._filtered({"albedo": albedo}),
            None if normal is None else self._filtered({"normal": normal}),
        )

    def denoise(self, color: Float32, albedo: Float32 | None, normal: Float32 | None) -> Float32:
        """Return colour (h, w, 3) without noise; the guides are those of `clean_guides`.

        OIDN uses the normal only where there is an albedo.
        """
        guides = {"albedo": albedo, "normal": normal if albedo is not None else None}
        images = {"color": color, **{name: image for name, image in guides.items() if image is not None}}
        return self._filtered(images, hdr=True, clean=albedo is not None)

    def _filtered(
        self, images: Mapping[str, NDArray[Any]], *, hdr: bool = False, clean: bool = False
    ) -> Float32:
        oidn = self._library
        arrays = {name: np.ascontiguousarray(image, np.float32) for name, image in images.items()}
        result = np.empty_like(next(iter(arrays.values())))
        run = oidn.Filter(self._device, oidn.OIDN_FILTER_TYPE_RT)
        try:
            for name, array in {**arrays, "output": result}.items():
                run.set_image(name, array, oidn.OIDN_FORMAT_FLOAT3)
            run.set_bool("hdr", hdr)
            run.set_bool("cleanAux", clean)
            run.set_quality(oidn.OIDN_QUALITY_HIGH)
            run.commit()
            run.execute()
            self._check()
        finally:
            run.release()
        return result

    def _check(self) -> None:
        """Raise what OIDN reports."""
        problem = self._device.get_error()
        if problem:
            raise SupersamplerError(f"Open Image Denoise failed: {problem}.")
