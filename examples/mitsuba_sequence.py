"""Upscale path-traced frames of Mitsuba 3: the history averages noise, so few samples per pixel suffice.

    pip install . mitsuba
    python examples/mitsuba_sequence.py --samples 1 4 16

A camera moves around a Cornell box. All samples of a render pixel are taken at one position, centre + jitter,
the position of depth and motion. Prints the PSNR of the last frame, after the display transform, against a
reference: of bicubic upscaling, taau, the classifier, and a full-size render with the same number of rays.

Mitsuba needs the library LLVM. If it ends with "Cannot select", this LLVM does not support the processor: set
$DRJIT_LIBLLVM_PATH to a newer one.
"""

import argparse
from collections.abc import Iterator
from typing import Any

import mitsuba as mi
import numpy as np

from supersampler import Frame, Upscaler
from supersampler.conventions import camera_motion, halton_jitter
from supersampler.io.display import auto_exposure, decibels, display_transform

mi.set_variant("llvm_ad_rgb")

SCALE = 2
NEAR = 0.1  # depth is NEAR / distance
FIELD_OF_VIEW = 40.0  # degrees, horizontal
UP = np.array([0.0, 1.0, 0.0])


def main() -> None:
    """Render and upscale the sequence with each number of samples."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--samples", type=int, nargs="+", default=[1, 4, 16], help="samples per render pixel")
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--size", type=int, default=128, help="width and height of the render, pixels")
    parser.add_argument("--reference-samples", type=int, default=1024)
    options = parser.parse_args()
    for row in measure(options.samples, options.frames, options.size, options.reference_samples):
        figures = [f"{name} {decibel:.1f} dB" for name, decibel in row["psnr"].items()]
        print(f"samples {row['samples']}: {', '.join(figures)}")


def measure(
    all_samples: list[int], frames: int, size: int, reference_samples: int
) -> Iterator[dict[str, Any]]:
    """Yield the PSNR of each image of the last frame, for each number of samples."""
    large, last = size * SCALE, frames - 1
    truth = spread(last, large, reference_samples, seed=10**6)
    exposure = auto_exposure(truth)
    shown = display_transform(truth, exposure)

    def psnr(image: Any) -> float:
        error = np.square(display_transform(image, exposure) - shown, dtype=np.float64)
        return decibels(float(error.mean()))

    for samples in all_samples:
        upscalers = {name: Upscaler(name, scale=SCALE) for name in ("bicubic", "taau", "classifier")}
        for index in range(frames):
            frame = rendered(index, size, samples)
            images = {name: upscaler.step(frame) for name, upscaler in upscalers.items()}
        found = {name: psnr(image) for name, image in images.items()}
        if samples >= SCALE**2:
            found["full size, as many rays"] = psnr(spread(last, large, samples // SCALE**2, seed=last))
        yield {"samples": samples, "psnr": found}


def camera(index: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return origin, direction, and projection @ view of a frame, without jitter; clip space y points up."""
    angle = np.radians(2.0 * index)
    origin = np.array([3.9 * np.sin(angle), 0.3, 3.9 * np.cos(angle)])
    forward = -origin / np.linalg.norm(origin)
    right = np.cross(forward, UP) / np.linalg.norm(np.cross(forward, UP))
    view = np.eye(4)
    view[:3, :3] = right, np.cross(right, forward), -forward
    view[:3, 3] = -view[:3, :3] @ origin
    slope = 1.0 / np.tan(np.radians(FIELD_OF_VIEW / 2))
    projection = np.diag([slope, slope, 0.0, 0.0])
    projection[2, 3], projection[3, 2] = NEAR, -1.0  # reversed, infinite far: depth is NEAR / distance
    return origin, forward, projection @ view


def scene_of(index: int, size: int) -> tuple[Any, Any]:
    """Return Mitsuba's scene and its camera at a frame."""
    origin, _, _ = camera(index)
    content = mi.cornell_box()
    content["sensor"] = {
        "type": "perspective",
        "fov": FIELD_OF_VIEW,
        "to_world": mi.ScalarTransform4f().look_at(origin.tolist(), [0, 0, 0], UP.tolist()),
        "film": {"type": "hdrfilm", "width": size, "height": size},
    }
    scene = mi.load_dict(content)
    return scene, scene.sensors()[0]


def traced(index: int, size: int, places: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Trace a path through each position; return radiance (n, 3) and view distance (n,), inf without a hit.

    Args:
        index: index of the frame.
        size: width and height of the image.
        places: (n, 2) in pixels, x right, y down.
        seed: seed of the random numbers.
    """
    scene, sensor = scene_of(index, size)
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, len(places))
    place = mi.Point2f((places / size).T.astype(np.float32))
    ray, weight = sensor.sample_ray(0.0, sampler.next_1d(), place, mi.Point2f(0.5))
    light, _, _ = mi.load_dict({"type": "path", "max_depth": 6}).sample(
        scene, sampler, mi.RayDifferential3f(ray)
    )
    hit = scene.ray_intersect(ray)
    origin, forward, _ = camera(index)
    distance = (np.array(hit.p).T - origin) @ forward
    distance[~np.array(hit.is_valid())] = np.inf
    return np.array(light * weight).T, distance


def rendered(index: int, size: int, samples: int) -> Frame:
    """Render a frame, with all samples through one position of each pixel."""
    jitter = halton_jitter(index, SCALE)
    rows, columns = np.mgrid[:size, :size]
    centres = np.stack([columns, rows], axis=-1).reshape(-1, 2) + 0.5
    places = np.repeat(centres + jitter, samples, axis=0)
    light, distance = traced(index, size, places, seed=index)
    color = light.reshape(size, size, samples, 3).mean(axis=2).astype(np.float32)
    depth = (NEAR / distance[::samples]).reshape(size, size).astype(np.float32)
    now, before = camera(index)[2], camera(max(0, index - 1))[2]
    motion = camera_motion(depth, now, before, jitter=jitter, near=NEAR)
    return Frame(color=color, depth=depth, motion=motion, jitter=jitter, reset=index == 0)


def spread(index: int, size: int, samples: int, seed: int) -> np.ndarray:
    """Render an image (size, size, 3) with samples spread over each pixel."""
    rows, columns = np.mgrid[:size, :size]
    corners = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    chance, total = np.random.default_rng(seed), np.zeros((size, size, 3))
    for done in range(samples):
        light, _ = traced(index, size, corners + chance.random(corners.shape), seed=seed + done)
        total += light.reshape(size, size, 3)
    image: np.ndarray = (total / samples).astype(np.float32)
    return image


if __name__ == "__main__":
    main()
