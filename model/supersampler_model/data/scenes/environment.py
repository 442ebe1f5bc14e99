"""Environment lighting: a panorama, its irradiance as spherical harmonics, its glossy reflections as mips."""

from dataclasses import dataclass

import numpy as np

from supersampler_model.data.checks import check_array
from supersampler_model.data.errors import SceneError
from supersampler_model.data.values import Points, Values

CONVOLVED = 64  # width from which on mips are true GGX convolutions; above, their lobes are a texel wide


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, weakref_slot=True)
class Environment:
    """A distant panorama.

    Attributes:
        pixels: (h, 2 h, 3) float32 linear RGB radiance, >= 0; h a power of two, 32 or more. Row 0 looks up
            (+y), the middle column looks at -z, columns go right.
    """

    pixels: Points

    def __post_init__(self) -> None:
        check_array("environment.pixels", self.pixels, (None, None, 3), np.float32)
        height, width = self.pixels.shape[:2]
        if width != 2 * height or height < 32 or height & (height - 1):
            want = "(h, 2 h, 3), h a power of two from 32 on"
            raise SceneError("environment.pixels", got=self.pixels.shape, want=want)
        if self.pixels.min() < 0.0:
            raise SceneError("environment.pixels", got="negative in places", want="radiance >= 0")

    def mips(self) -> list[Points]:
        """Return the panorama at half the size each, down to 4 x 2, blurred for ever rougher mirrors.

        Level l is what a mirror of alpha = pi 2^l / h reflects, so that a lobe is about two texels wide.
        """
        levels = [self.pixels]
        while levels[-1].shape[0] > 2:
            levels.append(halved(levels[-1]))
        source = next(level for level in levels if level.shape[1] <= 2 * CONVOLVED)
        for index, level in enumerate(levels):
            if level.shape[1] <= CONVOLVED and level is not source:
                alpha = min(1.0, np.pi / level.shape[0])
                levels[index] = reflected(source, level.shape[0], alpha)
        return levels

    def irradiance(self) -> Values:
        """Return (9, 3) coefficients: irradiance of a normal n is sum_i coefficients[i] basis_i(n).

        The basis is 1, x, y, z, xy, yz, 3 z^2 - 1, xz, x^2 - y^2, with all constants in the coefficients.
        """
        weights, basis = solid_angles(self.pixels.shape[0]), harmonics(directions(self.pixels.shape[0]))
        norm = np.array([0.282095] + [0.488603] * 3 + [1.092548] * 2 + [0.315392, 1.092548, 0.546274])
        lobe = np.array([np.pi] + [2.0 * np.pi / 3.0] * 3 + [np.pi / 4.0] * 5)  # of the clamped cosine
        radiance = (self.pixels.astype(np.float64) * weights[..., None]).reshape(-1, 3)
        return np.asarray((norm * norm * lobe)[:, None] * (basis.reshape(-1, 9).T @ radiance))


def directions(height: int) -> Values:
    """Return the unit vectors (h, 2 h, 3) of a panorama's texel centres."""
    theta = (np.arange(height) + 0.5) * np.pi / height
    phi = (np.arange(2 * height) + 0.5) * np.pi / height - np.pi
    sin = np.sin(theta)[:, None]
    y = np.broadcast_to(np.cos(theta)[:, None], (height, 2 * height))
    return np.stack([sin * np.sin(phi), y, -sin * np.cos(phi)], axis=-1)


def solid_angles(height: int) -> Values:
    """Return how much of the sphere each texel is: (h, 2 h) steradians that sum to 4 pi."""
    edges = np.cos(np.arange(height + 1) * np.pi / height)
    return np.repeat((edges[:-1] - edges[1:])[:, None] * np.pi / height, 2 * height, axis=1)


def harmonics(normals: Values) -> Values:
    """Return the nine functions of `Environment.irradiance` (..., 9) of unit vectors (..., 3)."""
    x, y, z = np.moveaxis(normals, -1, 0)
    columns = [np.ones_like(x), x, y, z, x * y, y * z, 3.0 * z * z - 1.0, x * z, x * x - y * y]
    return np.stack(columns, axis=-1)


def halved(pixels: Points) -> Points:
    """Average 2 x 2 texels, by their solid angle."""
    height, width = pixels.shape[:2]
    weighted = pixels * solid_angles(height)[..., None]
    sums = weighted.reshape(height // 2, 2, width // 2, 2, 3).sum(axis=(1, 3))
    return np.asarray(sums / solid_angles(height // 2)[..., None], np.float32)


def reflected(source: Points, height: int, alpha: float) -> Points:
    """Return what GGX mirrors of roughness alpha reflect, seen straight on: (height, 2 height, 3).

    Weights depend on the two rows and on how far apart the columns are, so each pair of rows is one circular
    correlation: those of the first column's normals, moved along the row in the frequency domain.
    """
    rows = source.shape[0]
    first = directions(height)[:, 0]  # (height, 3); its column is `rows / height` of the source's wide
    cosine = np.einsum(
        "ai,bci->abc", first, directions(rows)
    )  # of the normal, taken as the reflection, and light
    half = np.clip(0.5 + 0.5 * cosine, 0.0, 1.0)  # squared cosine of half that angle
    weights = np.maximum(cosine, 0.0) / (half * (alpha * alpha - 1.0) + 1.0) ** 2
    weights *= solid_angles(rows)
    weights /= weights.sum(axis=(1, 2), keepdims=True)
    spectrum = np.einsum(
        "abf,bfc->afc", np.conj(np.fft.rfft(weights, axis=2)), np.fft.rfft(source.astype(np.float64), axis=1)
    )
    return np.fft.irfft(spectrum, 2 * rows, axis=1)[:, :: rows // height].astype(np.float32)
