"""Render the frames of a scene at low resolution with jitter. Runs inside Blender without supersampler.

    SUPERSAMPLER_RENDER='{...}' blender --background --python-exit-code 1 --python render_frames.py

The environment variable holds the settings as JSON: see `main`. A line on stdout that begins with the token
of the settings is a message in JSON: {"note": ...} for a changed setting, {"scene": ...} once, {"frame":
number, "shift": ..., "camera": ...} for each rendered frame, {"error": ...} if the scene cannot be rendered.
The .blend file is never saved.
"""

import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

SETTINGS: dict[str, Any] = json.loads(os.environ.pop("SUPERSAMPLER_RENDER", "{}"))
"""Settings of the render; removed from the environment, which programs that Blender starts inherit."""


def report(**content: object) -> None:
    """Print one message for the parent process, on a line of its own."""
    sys.stdout.flush()
    os.write(1, f"\n{SETTINGS['token']}{json.dumps(content)}\n".encode())


try:
    import bpy
except ImportError as error:
    report(error=f"{sys.executable} is not Blender, and cannot import bpy: {error}")
    sys.exit(1)

OLDEST = (3, 6)  # Blender
PASSES = ("use_pass_combined", "use_pass_z", "use_pass_vector", "use_pass_normal", "use_pass_diffuse_color")
SAMPLES = 16  # per pixel in Cycles, denoised; docs/tutorials/blender.md compares numbers
EXACT_FILTER = ("BLACKMAN_HARRIS", 0.01)  # width in pixels: one position; that of BOX is always 1


class BlenderSceneError(Exception):
    """The scene cannot be rendered with these settings; the text says why and what to do."""


def main(settings: dict[str, Any]) -> None:
    """Render with these settings.

    Args:
        settings: "blend": file to open; "folder" to write to; "run": part of the files' temporary names;
            "token": begins each message; "display_size": [width, height] of the images, null for the scene's;
            "scale": display over render size; "frames": numbers of the first and the last, null for the
            scene's; "complete": how many of them, from the first on, are not to be rendered again; "jitter":
            [[x, y], ...] of the first frames, in render pixels, x right, y down, which then repeat;
            "engine", "scene", "camera": null for the scene's own; "samples", "denoise": null for SAMPLES and
            OIDN in Cycles, the scene's own elsewhere.
    """
    if bpy.app.version < OLDEST:
        raise BlenderSceneError(f"Blender {bpy.app.version_string} is too old; use 3.6 or later")
    bpy.ops.wm.open_mainfile(filepath=settings["blend"], load_ui=False)
    if bpy.app.autoexec_fail:
        what = f"Python in the file is not run ({bpy.app.autoexec_fail_message})"
        report(note=f"{what}: Auto Run Python Scripts is off in Blender's preferences")
    scene = chosen_scene(settings["scene"])
    choose_camera(scene, settings["camera"])
    set_engine(scene, settings["engine"], settings["samples"], settings["denoise"])
    layer = set_passes(scene)
    display_size = set_size(scene, settings["display_size"], settings["scale"])
    set_output(scene)
    first, last = settings["frames"] or own_range(scene)
    report(scene=facts(scene, layer, display_size))
    numbers, jitter = range(first + settings["complete"], last + 1), settings["jitter"]
    shift, moved = CameraShift(scene, numbers), MovedObjects(scene)
    for number in numbers:
        own_shift = shift.set(number, jitter[(number - first) % len(jitter)])
        moved.warn()
        render(scene, Path(settings["folder"]) / f".{number:04d}.{settings['run']}.partial.exr")
        report(frame=number, shift=own_shift, camera=camera_matrix(scene))


def own_range(scene: Any) -> tuple[int, int]:
    """Return the numbers of the scene's first and last frame."""
    if scene.frame_step != 1:
        problem = (
            f"the scene renders every {scene.frame_step}th frame, but motion leads to the previous frame"
        )
        raise BlenderSceneError(f"{problem}: pass --frames {scene.frame_start}-{scene.frame_end}")
    return scene.frame_start, scene.frame_end


def chosen_scene(name: str | None) -> Any:
    """Return the scene of that name, after making it the window's scene."""
    if name is not None:
        if name not in bpy.data.scenes:
            raise BlenderSceneError(f"no scene is named {name!r}; the file has {named(bpy.data.scenes)}")
        if bpy.context.window is not None:
            bpy.context.window.scene = bpy.data.scenes[name]
        return bpy.data.scenes[name]
    return bpy.context.scene


def choose_camera(scene: Any, name: str | None) -> None:
    """Make the camera of that name the scene's; check that it can be jittered."""
    cameras = [item for item in scene.objects if item.type == "CAMERA"]
    markers = [marker for marker in scene.timeline_markers if marker.camera]
    if name is not None:
        found = [item for item in cameras if item.name == name]
        if not found:
            raise BlenderSceneError(f"no camera is named {name!r}; the scene has {named(cameras)}")
        for marker in markers:
            marker.camera = None  # it would take the place of the one that is named
        scene.camera = found[0]  # last: each change of a marker chooses a camera
    if scene.camera is None:
        hint = f"pass --camera, one of {named(cameras)}" if cameras else "add one"
        raise BlenderSceneError(f"scene {scene.name!r} has no active camera: {hint}")
    if scene.camera.data.type == "PANO":
        raise BlenderSceneError(
            "a panoramic camera cannot be jittered; use a perspective or orthographic one"
        )
    if name is None and len({marker.camera.name for marker in markers}) > 1:
        switched = named([marker.camera for marker in markers])
        raise BlenderSceneError(
            f"markers switch cameras ({switched}): render each part with --frames and --camera"
        )


def set_engine(scene: Any, engine: str | None, samples: int | None, denoise: bool | None) -> None:
    """Choose engine, samples and denoising; no wide pixel filter, motion blur or depth of field."""
    if engine is not None:
        choose_engine(scene, engine)
    if scene.render.engine == "CYCLES":
        scene.cycles.pixel_filter_type, scene.cycles.filter_width = EXACT_FILTER
        scene.cycles.use_animated_seed = True  # the history averages noise that changes
        scene.cycles.use_adaptive_sampling = False
        scene.cycles.samples = SAMPLES if samples is None else samples
        scene.cycles.use_denoising = denoise is None or denoise
        scene.cycles.denoising_prefilter = "NONE"  # one position per pixel: OIDN's guides have no noise
        if samples is None or denoise is None:
            what = f"{scene.cycles.samples} samples, {'' if scene.cycles.use_denoising else 'not '}denoised"
            report(note=f"Cycles renders {what}; --samples and --no-denoise change it")
    elif scene.render.engine.startswith("BLENDER_EEVEE"):
        scene.render.filter_size = 0.0
        if samples is not None:
            scene.eevee.taa_render_samples = samples
    elif scene.render.engine == "BLENDER_WORKBENCH":
        if scene.camera.data.type == "ORTHO":
            raise BlenderSceneError(
                "Workbench writes no motion of an orthographic camera; use --engine eevee"
            )
        scene.display.render_aa = "OFF"
    else:
        raise BlenderSceneError(
            f"engine {scene.render.engine} is not supported; use --engine cycles, eevee or workbench"
        )
    if scene.render.use_motion_blur:
        scene.render.use_motion_blur = False
        report(note="motion blur is off: blurred frames cannot be reprojected")
    if scene.camera.data.dof.use_dof:
        scene.camera.data.dof.use_dof = False
        report(note="depth of field is off: blurred depth and motion cannot be reprojected")


def choose_engine(scene: Any, engine: str) -> None:
    """Choose cycles, eevee or workbench, whose names change between versions of Blender."""
    names = {
        "cycles": ("CYCLES",),
        "eevee": ("BLENDER_EEVEE_NEXT", "BLENDER_EEVEE"),
        "workbench": ("BLENDER_WORKBENCH",),
    }
    for name in names[engine]:
        try:
            scene.render.engine = name
        except TypeError:  # this version has none of that name
            continue
        return
    raise BlenderSceneError(f"this Blender has no engine {engine}")


def set_passes(scene: Any) -> str:
    """Enable the passes that are read, in addition to others, and return the view layer's name."""
    layers = [layer for layer in scene.view_layers if layer.use]
    if not layers:
        raise BlenderSceneError(f"all view layers of scene {scene.name!r} are off: turn one on")
    for name in PASSES:
        if hasattr(layers[0], name):
            setattr(layers[0], name, True)
    for other in layers[1:]:
        other.use = False
    if layers[1:]:
        report(note=f"view layer {layers[0].name!r} is rendered, not {named(layers[1:])}")
    return str(layers[0].name)


def set_size(scene: Any, display_size: list[int] | None, scale: float) -> tuple[int, int]:
    """Set the render size, display size / scale, and return the display size; by default the scene's own."""
    render = scene.render
    own = (
        render.resolution_x * render.resolution_percentage // 100,
        render.resolution_y * render.resolution_percentage // 100,
    )
    width, height = display_size or own
    if render.use_border:
        render.use_border = False
        report(note="the render border is off: whole frames are rendered")
    render.resolution_x, render.resolution_y = max(4, round(width / scale)), max(4, round(height / scale))
    render.resolution_percentage = 100
    return width, height


def set_output(scene: Any) -> None:
    """Write lossless multilayer EXR of floats, without compositing."""
    render, image = scene.render, scene.render.image_settings
    if hasattr(image, "media_type"):  # Blender 5
        image.media_type = "MULTI_LAYER_IMAGE"
    image.file_format, image.color_depth, image.exr_codec = "OPEN_EXR_MULTILAYER", "32", "ZIP"
    render.use_file_extension, render.use_overwrite, render.use_placeholder = True, True, False
    if render.use_compositing and (getattr(scene, "compositing_node_group", None) or scene.use_nodes):
        report(note="compositing is off: composite the upscaled frames")
    editor = scene.sequence_editor
    strips = editor and (getattr(editor, "strips", None) or getattr(editor, "sequences", None))
    if render.use_sequencer and strips:
        report(note="the sequencer is off: the scene itself is rendered")
    render.use_sequencer = render.use_compositing = False
    if getattr(render, "use_multiview", False):
        render.use_multiview = False
        report(note="stereoscopy is off: one view is rendered")


class CameraShift:
    """The camera's lens shift: the scene's own in each frame plus the jitter.

    It is keyed on every frame (of the scene in memory), because rendering evaluates the animation again.
    Blender's Vector pass contains no motion of the shift, neither of the jitter nor of an animation.
    """

    def __init__(self, scene: Any, numbers: range) -> None:
        self.scene = scene
        if scene.camera.library is not None or scene.camera.data.library is not None:
            scene.camera = own_copy(scene, scene.camera)
        self.data = scene.camera.data
        animated = self.data.animation_data is not None
        self.own = {number: self._read(number) for number in (numbers if animated else numbers[:1])}
        self.constant = None if animated else self.own[numbers[0]]
        for name in ("shift_x", "shift_y"):
            if animated:
                self.data.driver_remove(name)

    def set(self, number: int, jitter: list[float]) -> tuple[float, float]:
        """Go to a frame, add the jitter, and return the shift without it; both in render pixels."""
        x, y = self.constant or self.own[number]
        unit_x, unit_y = self._pixels()
        self.data.shift_x, self.data.shift_y = x + jitter[0] / unit_x, y - jitter[1] / unit_y
        for name in ("shift_x", "shift_y"):
            self.data.keyframe_insert(name, frame=number)
        self.scene.frame_set(number)
        return x * unit_x, y * unit_y

    def _read(self, number: int) -> tuple[float, float]:
        self.scene.frame_set(number)
        data = self.scene.camera.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        return data.shift_x, data.shift_y

    def _pixels(self) -> tuple[float, float]:
        """Return the render pixels of a shift of 1 in x and y: the side that the sensor fits."""
        render = self.scene.render
        width, height = render.resolution_x, render.resolution_y
        aspect = render.pixel_aspect_y / render.pixel_aspect_x
        fit = self.data.sensor_fit
        is_wide = width >= height * aspect if fit == "AUTO" else fit == "HORIZONTAL"
        side = width if is_wide else height * aspect
        return side, side / aspect


def own_copy(scene: Any, camera: Any) -> Any:
    """Return a copy of a linked camera, which Blender does not allow to change."""
    copied = camera.copy()
    copied.data = camera.data.copy()
    scene.collection.objects.link(copied)
    return copied


class MovedObjects:
    """Warns of objects that move, where the engine writes no Vector pass."""

    def __init__(self, scene: Any) -> None:
        self.scene = scene
        self.before: dict[str, Any] | None = None  # matrices of the previous frame
        self.is_active = scene.render.engine == "BLENDER_WORKBENCH"
        if self.is_active:
            report(note="Workbench writes no Vector pass: only the camera's motion is known")

    def warn(self) -> None:
        """Compare the present frame with the previous one; at most one warning."""
        if not self.is_active:
            return
        now = dict(self._matrices())
        moved = [name for name in now if self.before and self.before.get(name) not in (None, now[name])]
        self.before = now
        if moved:
            report(
                note=f"objects move, and will blur: {', '.join(moved[:8])}; --engine eevee has their motion"
            )
            self.is_active = False

    def _matrices(self) -> Iterator[tuple[str, Any]]:
        depsgraph = bpy.context.evaluated_depsgraph_get()
        for item in self.scene.objects:
            if item.type not in ("CAMERA", "LIGHT", "EMPTY") and not item.hide_render:
                yield item.name, item.evaluated_get(depsgraph).matrix_world.copy()


def render(scene: Any, path: Path) -> None:
    """Render the present frame into a file."""
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True, scene=scene.name)


def camera_matrix(scene: Any) -> list[list[float]]:
    """Return projection @ view of the present frame, with the shift that is set; clip space from -1 to 1."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    camera = scene.camera.evaluated_get(depsgraph)
    render = scene.render
    projection = camera.calc_matrix_camera(
        depsgraph, x=render.resolution_x, y=render.resolution_y,
        scale_x=render.pixel_aspect_x, scale_y=render.pixel_aspect_y,
    )  # fmt: skip
    return [list(row) for row in projection @ camera.matrix_world.normalized().inverted()]


def facts(scene: Any, layer: str, display_size: tuple[int, int]) -> dict[str, object]:
    """Return the facts of the scene that the reader of the frames needs."""
    render, view = scene.render, scene.view_settings
    own = Path(bpy.utils.system_resource("DATAFILES"))
    return {
        "name": scene.name,
        "blender": bpy.app.version_string,
        "numbers": [scene.frame_start, scene.frame_end],
        "frame_rate": render.fps / render.fps_base,
        "render_size": [render.resolution_x, render.resolution_y],
        "display_size": display_size,
        "engine": render.engine,
        "layer": layer,
        "view": {
            "display": scene.display_settings.display_device, "view": view.view_transform, "look": view.look,
            "exposure": view.exposure, "gamma": view.gamma,
        },
        "ocio": os.environ.get("OCIO") or str(own / "colormanagement" / "config.ocio"),
    }  # fmt: skip


def named(items: Any) -> str:
    """Return names with commas between."""
    return ", ".join(item.name for item in items) or "none"


if __name__ == "__main__":
    try:
        main(SETTINGS)
    except (BlenderSceneError, RuntimeError) as error:  # Blender's operators raise RuntimeError
        report(error=" ".join(str(error).split()))
        sys.exit(1)
