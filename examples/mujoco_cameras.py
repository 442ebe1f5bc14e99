"""Render sixteen cameras of a MuJoCo simulation small, and upscale them in one call, with segmentation ids.

    MUJOCO_GL=egl python examples/mujoco_cameras.py -o out/mujoco

Needs `pip install mujoco`, and EGL or OSMesa; software OpenGL suffices. Half of the cameras orbit. Prints
times, and errors against images that MuJoCo renders at four times the size. Writes cameras.png, which shows
four cameras: the render, the output, and MuJoCo's render at full size with MSAA, above their ids.
"""

import os
import sys
from argparse import ArgumentDefaultsHelpFormatter, ArgumentParser, Namespace
from pathlib import Path
from statistics import mean, median
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler import Frame, Model, StepResult, SupersamplerError, Upscaler, halton_jitter
from supersampler.conventions.encodings import srgb_decoded, srgb_encoded
from supersampler.io.images import write_png

if sys.platform == "linux":
    os.environ.setdefault("MUJOCO_GL", "egl")
import mujoco

Array = NDArray[Any]
KEY = np.array([1, 1 << 20])  # times ids, object and type: one number per object
SUPERSAMPLES = 4  # samples per pixel of the references, on each axis
WARM_UP = 8  # number of first frames that are not scored
SCENE = """
<mujoco>
  <visual>
    <global offwidth="{size}" offheight="{size}" fovy="50"/>
    <quality offsamples="{samples}" shadowsize="1024"/>
    <map znear="0.05"/>
  </visual>
  <asset>
    <texture type="skybox" builtin="gradient" rgb1=".6 .75 .9" rgb2=".2 .25 .35" width="64" height="64"/>
    <texture name="tiles" type="2d" builtin="checker" rgb1=".7 .7 .6" rgb2=".3 .3 .4" width="64" height="64"/>
    <material name="floor" texture="tiles" texrepeat="12 12"/>
    <material name="steel" rgba=".7 .72 .75 1" specular="1" shininess=".8"/>
  </asset>
  <default>
    <geom solref=".01 1" material="steel"/>
    <default class="leg"><geom type="cylinder" size=".015 .25"/></default>
    <default class="arm"><geom type="capsule" rgba=".95 .55 .1 1"/></default>
    <default class="wire"><geom type="capsule" size=".004"/></default>
  </default>
  <worldbody>
    <light pos="1 -1 3" dir="-.3 .3 -1" castshadow="true"/>
    <geom type="plane" size="3 3 .1" material="floor"/>
    <geom type="box" size=".5 .5 .02" pos="0 0 .5" rgba=".6 .4 .25 1"/>
    <geom class="leg" pos=".45 .45 .25"/>
    <geom class="leg" pos="-.45 .45 .25"/>
    <geom class="leg" pos=".45 -.45 .25"/>
    <geom class="leg" pos="-.45 -.45 .25"/>
    <geom class="wire" fromto="-.5 .48 .53 -.5 .48 1.3"/>
    <geom class="wire" fromto=".5 .48 .53 .5 .48 1.3"/>
    <geom class="wire" fromto="-.5 .48 1.2 .5 .48 1.25" rgba=".1 .1 .1 1"/>
    <body pos="0 0 .52">
      <joint name="turn" axis="0 0 1" damping=".2"/>
      <geom type="cylinder" size=".05 .06" pos="0 0 .06" rgba=".2 .2 .22 1"/>
      <geom class="arm" fromto="0 0 .1 .1 0 .42" size=".025"/>
      <body pos=".1 0 .42">
        <joint name="lift" axis="0 1 0" damping=".2"/>
        <geom class="arm" fromto="0 0 0 .3 0 .04" size=".018"/>
        <geom class="wire" fromto=".3 .03 .04 .4 .03 -.03"/>
        <geom class="wire" fromto=".3 -.03 .04 .4 -.03 -.03"/>
      </body>
    </body>
    {bodies}
  </worldbody>
  <actuator><position joint="turn" kp="8"/><position joint="lift" kp="8"/></actuator>
</mujoco>
"""
PARTS = 3 * [("box", ".04 .05 .03"), ("capsule", ".02 .06"), ("cylinder", ".03 .04")]
BODIES = "".join(
    f'<body pos="{0.3 * np.cos(k):.2f} {0.3 * np.sin(k):.2f} {0.7 + 0.08 * k:.2f}" '
    f'euler="{20 * k} {35 * k} 0"><freejoint/><geom type="{kind}" size="{size}" '
    f'rgba="{0.3 + 0.07 * k:.2f} {0.9 - 0.08 * k:.2f} .5 1"/></body>'
    for k, (kind, size) in enumerate(PARTS)
)


class Camera(NamedTuple):
    """Position and axes of a camera in world space, and the tangent of half its field of view."""

    position: Array
    axes: Array  # rows: right, down, forward
    tangent: float

    def pixels(self, points: Array, size: int) -> Array:
        """Return the pixels (x, y) of points (..., 3) relative to the camera, without jitter."""
        right, down, forward = np.moveaxis(points @ self.axes.T, -1, 0)
        scale = 0.5 * size / (self.tangent * np.maximum(forward, 1e-6))
        return np.stack([right * scale, down * scale], -1) + (0.5 * size - 0.5)


def poses(scene: Any, data: Any) -> dict[int, list[Array]]:
    """Return the shapes of each rendered object, by `KEY` @ its ids; a tendon has several.

    A shape is (3, 5): rotation, position, half of its size along its own axes.
    """
    found: dict[int, list[Array]] = {}
    for shape in scene.geoms[: scene.ngeom]:  # sites, tendons and deformables, too
        if shape.objtype != mujoco.mjtObj.mjOBJ_UNKNOWN:  # contacts have other numbers in each frame
            pose = np.column_stack([shape.mat, shape.pos, shape.size])
            found.setdefault(int(KEY @ (shape.objid, shape.objtype)), []).append(pose)
    geoms = zip(data.geom_xmat.reshape(-1, 3, 3), data.geom_xpos, np.ones_like(data.geom_xpos), strict=True)
    for index, columns in enumerate(geoms):  # in `scene`, infinite planes follow the camera
        found[int(KEY @ (index, mujoco.mjtObj.mjOBJ_GEOM))] = [np.column_stack(columns)]
    return found


def closest(shapes: list[Array], points: Array) -> Array:
    """Return the index of the shape that each point (n, 3) is on."""
    if len(shapes) == 1:
        return np.zeros(len(points), int)
    each = np.stack(shapes)
    own = np.einsum("kji,nkj->nki", each[..., :3], points[:, None] - each[..., 3])
    return np.asarray(np.abs(own / np.maximum(each[..., 4], 1e-9)).max(axis=2).argmin(axis=1))


class View:
    """A camera, with its pose and those of all objects in the previous frame."""

    def __init__(self, index: int, count: int) -> None:
        self._index, self._count = index, count
        self._before: tuple[Camera, dict[int, list[Array]]] | None = None

    def aim(self, renderer: Any, data: Any, time: float, jitter: tuple[float, float]) -> Camera:
        """Update the renderer's scene; samples are taken at pixel centre + jitter."""
        camera = mujoco.MjvCamera()
        camera.lookat[:] = 0.0, 0.0, 0.6
        camera.distance, camera.elevation = 1.3 + 0.2 * (self._index % 3), -15.0 - 8.0 * (self._index % 4)
        orbit = 25.0 * time * (self._index % 2)
        camera.azimuth = 360.0 * self._index / self._count + orbit
        renderer.update_scene(data, camera)
        first = renderer.scene.camera[0]
        height = first.frustum_top - first.frustum_bottom
        tangent = 0.5 * height / first.frustum_near
        for eye in renderer.scene.camera:  # MuJoCo averages both
            eye.frustum_center += jitter[0] * height / renderer.width
            eye.frustum_bottom -= jitter[1] * height / renderer.height
            eye.frustum_top -= jitter[1] * height / renderer.height
        forward, up = np.array(first.forward, float), np.array(first.up, float)
        position = np.mean([eye.pos for eye in renderer.scene.camera], axis=0)
        return Camera(position, np.stack([np.cross(forward, up), -up, forward]), tangent)

    def frame(self, renderer: Any, data: Any, time: float, jitter: tuple[float, float]) -> Frame:
        """Render colour, depth and ids, and compute motion from poses of objects and of the camera."""
        camera, size = self.aim(renderer, data, time, jitter), renderer.width
        color, distance, ids = rendered(renderer)
        there = poses(renderer.scene, data)
        before_camera, before_poses = self._before or (camera, there)
        seen = ids[..., 0] >= 0
        y, x = np.mgrid[:size, :size].astype(float)
        here = np.stack([x + jitter[0], y + jitter[1]], -1)  # positions of the samples
        slopes = (here - (0.5 * size - 0.5)) * (2.0 * camera.tangent / size)
        rays = np.concatenate([slopes, np.ones((size, size, 1))], -1) @ camera.axes
        points = camera.position + rays * distance[..., None]
        keys = ids @ KEY
        of_now: list[Array] = []
        of_before: list[Array] = []
        shape_of = np.zeros((size, size), int)  # of each sample, in these lists
        for key in np.unique(keys).tolist():
            shapes = there.get(key, [np.eye(3, 5)])  # of the sky
            earlier = before_poses.get(key, shapes)  # what is new has not moved
            shape_of[keys == key] = len(of_now) + closest(shapes, points[keys == key])
            of_now += shapes
            of_before += earlier if len(earlier) == len(shapes) else shapes
        now, then = (np.stack(of)[shape_of] for of in (of_now, of_before))
        own = np.einsum("...ji,...j->...i", now[..., :3], points - now[..., 3])
        moved = np.einsum("...ij,...j->...i", then[..., :3], own) + then[..., 3]
        # the sky is infinitely far away
        before = np.where(seen[..., None], moved - before_camera.position, rays)
        reset, self._before = self._before is None, (camera, there)
        return Frame(
            color=color,
            depth=np.where(seen, 1.0 / distance, 0.0).astype(np.float32),
            motion=(before_camera.pixels(before, size) - here).astype(np.float32),
            jitter=jitter,
            reset=reset,
            exposure=1.0,
            ids=ids,
        )


def rendered(renderer: Any) -> tuple[Array, Array, Array]:
    """Return linear colour (h, w, 3), distance along the view (h, w), and ids (h, w, 2): object, type."""
    color = srgb_decoded(renderer.render().astype(np.float32) / 255.0)
    renderer.enable_depth_rendering()
    distance = renderer.render()
    renderer.disable_depth_rendering()
    renderer.enable_segmentation_rendering()
    ids = renderer.render()
    renderer.disable_segmentation_rendering()
    return color, distance, ids


def make_renderer(size: int, *, samples: int) -> Any:
    """Return a renderer of square images with this number of MSAA samples."""
    text = SCENE.replace("{size}", str(size)).replace("{samples}", str(samples)).replace("{bodies}", BODIES)
    return mujoco.Renderer(mujoco.MjModel.from_xml_string(text), size, size)


def main(options: Namespace) -> None:
    size = options.size
    small, full, large = (
        make_renderer(size // 2, samples=0),
        make_renderer(size, samples=4),
        make_renderer(SUPERSAMPLES * size, samples=0),
    )
    data = mujoco.MjData(small.model)
    model = Model.load(options.model)
    views = [View(index, options.cameras) for index in range(options.cameras)]
    upscalers = [Upscaler(model, display_size=(size, size)) for _ in views]
    times: dict[str, list[float]] = {"rendered small": [], "step_many": [], "rendered in full": []}
    errors: dict[str, list[float]] = {}

    for index in range(options.frames):
        data.ctrl[:] = np.sin(2.0 * data.time), 0.5 * np.sin(3.1 * data.time)
        mujoco.mj_step(small.model, data, nstep=8)
        jitter, moments = halton_jitter(index, 2.0), [perf_counter()]
        frames = [view.frame(small, data, data.time, jitter) for view in views]
        moments.append(perf_counter())
        results = Upscaler.step_many(upscalers, frames, outputs=("ids",))
        moments.append(perf_counter())
        own = []
        for view in views:
            view.aim(full, data, data.time, (0.0, 0.0))
            own.append(rendered(full))
        moments.append(perf_counter())
        for seconds, taken in zip(times.values(), np.diff(moments), strict=True):
            seconds.append(taken)
        if index >= WARM_UP and index % options.score_every == 0:
            for view, frame, result, (color, _, ids) in zip(views, frames, results, own, strict=True):
                view.aim(large, data, data.time, (0.0, 0.0))
                truth = srgb_decoded(large.render().astype(np.float32) / 255.0)
                truth = truth.reshape(size, SUPERSAMPLES, size, SUPERSAMPLES, 3).mean((1, 3))
                score(errors, frame, result, color, ids, truth)

    for name, seconds in times.items():
        print(f"{name}: {1e3 * median(seconds[WARM_UP:] or seconds):.1f} ms for {len(views)} cameras")
    for name, values in errors.items():
        print(f"{name}: {mean(values):.2f}")
    rows = [comparison(*each) for each in list(zip(frames, results, own, strict=True))[:4]]
    write_png(options.output / "cameras.png", np.concatenate(rows, axis=1))


def score(
    errors: dict[str, list[float]], frame: Frame, result: StepResult, color: Array, ids: Array, truth: Array
) -> None:
    """Add the errors of the images against the reference, and of the ids against MuJoCo's at full size."""
    for name, image in (("nearest", enlarged(frame.color)), ("upscaled", result.image), ("MSAA", color)):
        squares = np.square(srgb_encoded(np.clip(image, 0.0, 1.0)) - srgb_encoded(truth))
        errors.setdefault(f"PSNR {name}, dB", []).append(-10.0 * np.log10(squares.mean()))
    for name, found in (("nearest", enlarged(frame.ids)), ("upscaled", np.asarray(result.ids))):
        wrong = np.not_equal(found, ids).any(axis=2)
        errors.setdefault(f"wrong ids {name}, %", []).append(100.0 * wrong.mean())


def enlarged(image: Any) -> Array:
    """Return an image (h, w, k) with each pixel doubled on both axes."""
    return np.asarray(image).repeat(2, axis=0).repeat(2, axis=1)


def comparison(frame: Frame, result: StepResult, own: tuple[Array, Array, Array]) -> NDArray[np.uint8]:
    """Return the render, the output and MuJoCo's own image side by side, above their ids in false colours."""
    images = [enlarged(frame.color), result.image, own[0]]
    shown = [np.rint(255.0 * srgb_encoded(np.clip(image, 0.0, 1.0))).astype(np.uint8) for image in images]
    names = [ids[..., :1] for ids in (enlarged(frame.ids), np.asarray(result.ids), own[2])]
    colors = [((ids + 1) * np.array([37, 91, 151]) % 256).astype(np.uint8) for ids in names]
    return np.concatenate([np.concatenate(row, axis=1) for row in (shown, colors)])


if __name__ == "__main__":
    parser = ArgumentParser(
        description=__doc__.splitlines()[0], formatter_class=ArgumentDefaultsHelpFormatter
    )
    parser.add_argument("--cameras", type=int, default=16, help="number of cameras")
    parser.add_argument("--size", type=int, default=256, help="width and height of the images")
    parser.add_argument(
        "--frames", type=int, default=48, help=f"number of frames; the first {WARM_UP} are not scored"
    )
    parser.add_argument("--model", default="classifier", help="model of the upscalers")
    parser.add_argument("--score-every", type=int, default=8, help="score every this many frames")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/mujoco"), help="folder of the image")
    given = parser.parse_args()
    for name in ("cameras", "size", "frames", "score_every"):
        if getattr(given, name) < 1:
            parser.error(f"--{name.replace('_', '-')} is {getattr(given, name)}; want at least 1")
    if given.size % 2:
        parser.error(f"--size is {given.size}; want an even number: half of it is rendered")
    try:
        main(given)
    except SupersamplerError as error:
        sys.exit(str(error))
