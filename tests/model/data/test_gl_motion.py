"""Motion, jitter and previous depth of the renderer, compared with images that do not depend on them."""

from dataclasses import replace

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from numpy.typing import NDArray

from gl_scenes import Yard, unlit
from supersampler import Frame, halton_jitter
from supersampler.io.display import display_transform
from supersampler.sequence.backward_motion import scattered_motion
from supersampler_bench.quality.metrics import psnr
from supersampler_model.data.labels import PixelStatistics
from supersampler_model.data.rendered import SurfaceBuffers
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.scenes.scene import Scene

Values = NDArray[np.float64]
Mask = NDArray[np.bool_]


def read_at(image: NDArray[np.floating], motion: Values, mode: str = "bicubic") -> Values:
    """Read (h, w, c) at each pixel + motion, in pixels."""
    h, w = image.shape[:2]
    y, x = np.mgrid[:h, :w] + 0.5
    places = np.stack([(x + motion[..., 0]) / w, (y + motion[..., 1]) / h], axis=-1) * 2.0 - 1.0
    pixels = torch.from_numpy(np.moveaxis(image, -1, 0)[None].astype(np.float64))
    read = F.grid_sample(pixels, torch.from_numpy(places)[None], mode, "border", align_corners=False)
    return np.asarray(np.moveaxis(read[0].numpy(), 0, -1))


def widest(values: Values, radius: int) -> Values:
    pooled = F.max_pool2d(torch.from_numpy(values)[None, None], 2 * radius + 1, 1, radius)
    return np.asarray(pooled[0, 0].numpy())


def undisturbed(now: SurfaceBuffers, truth_now: PixelStatistics, truth_before: PixelStatistics) -> Mask:
    """Return a mask of the pixels seen in the previous frame, away from depth edges and the border."""
    motion = now.motion.astype(np.float64)
    edges = []
    for truth in (truth_now, truth_before):
        spread = (truth.depth_max - truth.depth_min) / np.maximum(truth.depth_max, 1e-9)
        edges.append((widest((spread > 0.06).astype(np.float64), 2) > 0.0).astype(np.float64))
    least, most, edge_before = (
        read_at(image[..., None].astype(np.float64), motion, "nearest")[..., 0]
        for image in (truth_before.depth_min, truth_before.depth_max, edges[1])
    )
    seen = (now.previous_depth >= least * 0.995) & (now.previous_depth <= most * 1.005)
    mask = seen & (edges[0] == 0.0) & (edge_before == 0.0)
    mask[:6] = mask[-6:] = mask[:, :6] = mask[:, -6:] = False
    return np.asarray(mask)


def shift_between(image: Values, other: NDArray[np.floating], where: Mask) -> Values:
    """The (x, y) by which `image` has to be read elsewhere to show `other`: least squares, in pixels."""
    down, across = (np.asarray(np.gradient(image, axis=axis)) for axis in (0, 1))
    slopes = np.stack([across[where].ravel(), down[where].ravel()], axis=-1)
    return np.asarray(np.linalg.lstsq(slopes, (other - image)[where].ravel(), rcond=None)[0])


def seen_alone(renderer: Renderer, scene: Scene, instance: int, depth: NDArray[np.float32]) -> Mask:
    """Return a mask of the pixels that see only this instance, two pixels from its rim."""
    alone = renderer.display(replace(scene, instances=scene.instances[instance : instance + 1])).depth
    hidden = ((alone == 0.0) | (alone != depth)).astype(np.float64)
    return np.asarray(widest(hidden, 2) == 0.0)


def test_motion_warps_the_history_onto_the_present(renderer: Renderer) -> None:
    before, scene = unlit(Yard().scene(3)), unlit(Yard().scene(4))
    past, truth, now = renderer.reference(before), renderer.reference(scene), renderer.display(scene)
    where, motion = undisturbed(now, truth, past), now.motion.astype(np.float64)
    assert where.mean() > 0.5
    assert np.linalg.norm(motion, axis=-1)[where].mean() > 0.5  # pixels: there is something to get wrong

    history, present = display_transform(past.color), display_transform(truth.color)
    warped = psnr(read_at(history, motion), present, where)
    assert warped >= 34.0
    for wrong in ((0, 0), (-1, -1), (-1, 1), (1, -1)):
        assert psnr(read_at(history, motion * wrong), present, where) <= warped - 10.0


@pytest.mark.parametrize("instance", [pytest.param(1, id="moving box"), pytest.param(5, id="skinned tube")])
def test_moving_objects_are_where_their_motion_points(renderer: Renderer, instance: int) -> None:
    yard = Yard()
    before, scene = unlit(yard.scene(3)), unlit(yard.scene(4))
    past, truth, now = renderer.reference(before), renderer.reference(scene), renderer.display(scene)
    where = seen_alone(renderer, scene, instance, now.depth) & undisturbed(now, truth, past)
    assert where.sum() > 150
    motion = now.motion.astype(np.float64)
    assert np.linalg.norm(motion, axis=-1)[where].mean() > 1.0

    shown = read_at(display_transform(past.color), motion)
    residual = shift_between(shown, display_transform(truth.color), where)
    assert np.abs(residual).max() < 0.05
    still = renderer.display(replace(scene, instances=Yard(still=True).instances(0))).motion
    assert (
        np.linalg.norm((now.motion - still)[where], axis=-1).mean() > 0.5
    )  # the camera alone does not do it


def test_static_objects_have_zero_motion(renderer: Renderer) -> None:
    assert not renderer.display(Yard(still=True).scene(5)).motion.any()


def scattered(renderer: Renderer, scene: Scene, sign: float) -> Values:
    """Average jittered frames of half size, each sample into the display pixel where it was taken."""
    width, height = renderer.display_size
    sums, counts = np.zeros((height, width, 3)), np.zeros((height, width, 1))
    for x, y in np.mgrid[:16, :16].reshape(2, -1).T:
        jitter = (float(x) + 0.5) / 16 - 0.5, (float(y) + 0.5) / 16 - 0.5
        color = renderer.frame(scene, (width // 2, height // 2), jitter=jitter)[0]
        right, below = (int(sign * offset > 0.0) for offset in jitter)
        sums[below::2, right::2] += color
        counts[below::2, right::2] += 1.0
    return np.asarray(sums / counts)


def test_jittered_frames_average_to_the_reference(renderer: Renderer) -> None:
    scene = Yard().scene(4)
    truth = display_transform(renderer.reference(scene).color)
    right, wrong = (psnr(display_transform(scattered(renderer, scene, sign)), truth) for sign in (1.0, -1.0))
    assert right >= 45.0
    assert wrong <= right - 15.0


def test_previous_depth_is_the_depth_a_frame_ago(renderer: Renderer) -> None:
    yard = Yard()
    before, scene = yard.scene(3), yard.scene(4)
    past, truth, now = renderer.reference(before), renderer.reference(scene), renderer.display(scene)
    where = undisturbed(now, truth, past) & (now.depth > 0.0)
    depth_before = renderer.display(before).depth[..., None].astype(np.float64)

    # Depth is linear on the screen where a surface is flat, so that reading between pixels is exact there.
    read = read_at(depth_before, now.motion.astype(np.float64), "bilinear")[..., 0]
    error = np.abs(read[where] / now.previous_depth[where] - 1.0)
    assert np.quantile(error, 0.9) < 1e-5
    assert np.quantile(error, 0.99) < 2e-3  # round things, between pixels
    box = where & seen_alone(renderer, scene, 1, now.depth)
    assert np.abs(now.depth[box] / now.previous_depth[box] - 1.0).mean() > 2e-3  # it was elsewhere


def towards(scene: Scene, following: Scene) -> Scene:
    """A scene whose motion vectors lead to the next frame: next minus current."""
    pairs = zip(scene.instances, following.instances, strict=True)
    instances = [replace(now, model_before=b.model, palette_before=b.palette) for now, b in pairs]
    return replace(scene, instances=tuple(instances), camera_before=following.camera)


def test_motion_to_the_next_frame_is_what_scattering_its_motion_finds(renderer: Renderer) -> None:
    """Motion to the next frame from two sources: rendered, and by `scattered_motion`."""
    yard, size, jitters = Yard(), (80, 45), [halton_jitter(index, 2.0) for index in (4, 5)]
    scenes = [yard.scene(4), yard.scene(5)]
    surfaces = [renderer.frame(s, size, jitter=j)[1] for s, j in zip(scenes, jitters, strict=True)]
    now, after = (
        Frame(color=None, depth=s.depth, motion=s.motion, jitter=j)
        for s, j in zip(surfaces, jitters, strict=True)
    )
    truth = renderer.frame(towards(*scenes), size, jitter=jitters[0])[1].motion.astype(np.float32)
    assert np.linalg.norm(truth, axis=-1).mean() > 0.3
    off = np.linalg.norm(scattered_motion(now, after) - truth, axis=-1)
    assert np.median(off) < 0.02
    assert (off > 0.5).mean() < 0.02
