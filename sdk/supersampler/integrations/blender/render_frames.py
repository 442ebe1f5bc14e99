"""Render the frames of a scene small and with jitter. Runs inside Blender; imports bpy and nothing of ours.

    blender --background scene.blend --python-exit-code 1 --python render_frames.py -- settings.json

settings.json: see `main`. Each line on stdout that begins with "supersampler " is a JSON object:
{"scene": ...} once, {"note": ...} for what is changed, {"frame": number, "file": path, ...} for each frame
that is complete, {"error": ...} where the scene will not do. The .blend file is never saved.
"""

import json
import sys
from pathlib import Path
from typing import Any

import bpy

LINE = "supersampler "
PASSES = ("use_pass_combined", "use_pass_z", "use_pass_vector", "use_pass_normal", "use_pass_diffuse_color")
EXACT_FILTER = 0.01  # of a pixel: each is one place, and depth and motion belong to it


class SceneError(Exception):
    """The scene cannot be rendered so; the text says why and what to do."""


def tell(**content: object) -> None:
    """Print one line for the process that reads."""
    print(LINE + json.dumps(content), flush=True)


def main(settings: dict[str, Any]) -> None:
    """Render what the settings say.

    Args:
        settings: "folder" to write to; "scale" display over render size, or "display_size" [width, height] of
            the images; "frames": list of numbers, or null for the scene's range; "jitter": list of [x, y], in
            render pixels, x right, y down, repeated; "engine", "samples", "denoise", "scene", "camera": null
            for the scene's own; "blend": file to open, where Blender was not given one.
    """
    if settings.get("blend"):
        bpy.ops.wm.open_mainfile(filepath=settings["blend"], load_ui=False)
    scene = chosen_scene(settings.get("scene"))
    choose_camera(scene, settings.get("camera"))
    set_engine(scene, settings.get("engine"), settings.get("samples"), settings.get("denoise"))
    set_passes(scene)
    set_size(scene, settings)
    set_output(scene)
    frames = settings.get("frames") or list(range(scene.frame_start, scene.frame_end + 1, scene.frame_step))
    tell(scene=facts(scene, frames))
    shift = CameraShift(scene, frames)
    for place, number in enumerate(frames):
        path = Path(settings["folder"]) / f"{number:04d}.exr"
        own_shift = shift.set(number, settings["jitter"][place % len(settings["jitter"])])
        if not path.exists():
            render(scene, path)
        tell(frame=number, file=str(path), shift=own_shift, camera=camera_matrix(scene))


def chosen_scene(name: str | None) -> Any:
    """Return the scene of that name, shown in the window."""
    if name is not None:
        if name not in bpy.data.scenes:
            raise SceneError(f"no scene is named {name!r}; there are {named(bpy.data.scenes)}")
        if bpy.context.window is not None:
            bpy.context.window.scene = bpy.data.scenes[name]
        return bpy.data.scenes[name]
    return bpy.context.scene


def choose_camera(scene: Any, name: str | None) -> None:
    """Make the camera of that name the scene's; check that it can be jittered."""
    cameras = [item for item in scene.objects if item.type == "CAMERA"]
    if name is not None:
        found = [item for item in cameras if item.name == name]
        if not found:
            raise SceneError(f"no camera is named {name!r}; there are {named(cameras)}")
        scene.camera = found[0]
    if scene.camera is None:
        hint = f"give --camera, one of {named(cameras)}" if cameras else "add one"
        raise SceneError(f"scene {scene.name!r} has no active camera: {hint}")
    if scene.camera.data.type == "PANO":
        raise SceneError("a panoramic camera cannot be jittered; take a perspective or orthographic one")
    markers = [marker.camera.name for marker in scene.timeline_markers if marker.camera]
    if len(set(markers)) > 1:
        raise SceneError(
            f"markers switch cameras ({', '.join(markers)}): render each part by --frames, --camera"
        )


def set_engine(scene: Any, engine: str | None, samples: int | None, denoise: bool | None) -> None:
    """Choose engine, samples and denoising; no wide pixel filter, motion blur or depth of field."""
    if engine is not None:
        scene.render.engine = engine_name(engine)
    if scene.render.engine == "CYCLES":
        scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", EXACT_FILTER
        if samples is not None:
            scene.cycles.samples = samples
            scene.cycles.use_adaptive_sampling = False
        if denoise is not None:
            scene.cycles.use_denoising = denoise
    elif scene.render.engine.startswith("BLENDER_EEVEE"):
        scene.render.filter_size = 0.0
        if samples is not None:
            scene.eevee.taa_render_samples = samples
    elif scene.render.engine == "BLENDER_WORKBENCH":
        scene.display.render_aa = "OFF"
    else:
        raise SceneError(
            f"engine {scene.render.engine} is not supported; give --engine cycles, eevee or workbench"
        )
    if scene.render.use_motion_blur:
        scene.render.use_motion_blur = False
        tell(note="motion blur is off: it blurs what the history must follow")
    if scene.camera.data.dof.use_dof:
        scene.camera.data.dof.use_dof = False
        tell(note="depth of field is off: blurred depth and motion belong to no place")


def engine_name(engine: str) -> str:
    """Return Blender's name of cycles, eevee or workbench, which changes between its versions."""
    known = bpy.types.RenderSettings.bl_rna.properties["engine"].enum_items.keys()
    wanted = {
        "cycles": ("CYCLES",),
        "eevee": ("BLENDER_EEVEE_NEXT", "BLENDER_EEVEE"),
        "workbench": ("BLENDER_WORKBENCH",),
    }
    for name in wanted[engine]:
        if name in known or name == "CYCLES":
            return name
    raise SceneError(f"this Blender has no {engine}; it has {', '.join(known)}")


def set_passes(scene: Any) -> None:
    """Turn on the passes that are read, besides those that are on."""
    for layer in scene.view_layers:
        for name in PASSES:
            if layer.use and hasattr(layer, name):
                setattr(layer, name, True)
    if scene.render.engine == "BLENDER_WORKBENCH":
        tell(note="Workbench writes no Vector pass: only the camera's motion is known")


def set_size(scene: Any, settings: dict[str, Any]) -> None:
    """Set the render size: the scene's own size, or the one wanted, over the scale."""
    render = scene.render
    own = (
        render.resolution_x * render.resolution_percentage // 100,
        render.resolution_y * render.resolution_percentage // 100,
    )
    width, height = settings.get("display_size") or own
    scale = settings["scale"]
    if render.use_border:
        render.use_border = False
        tell(note="the render border is off: whole frames are rendered")
    render.resolution_x, render.resolution_y = max(4, round(width / scale)), max(4, round(height / scale))
    render.resolution_percentage = 100


def set_output(scene: Any) -> None:
    """Write multilayer EXR, float, lossless, of the render alone."""
    render, image = scene.render, scene.render.image_settings
    if hasattr(image, "media_type"):  # Blender 5
        image.media_type = "MULTI_LAYER_IMAGE"
    image.file_format, image.color_depth, image.exr_codec = "OPEN_EXR_MULTILAYER", "32", "ZIP"
    render.use_file_extension, render.use_overwrite, render.use_placeholder = True, True, False
    render.use_sequencer = render.use_compositing = False
    if getattr(render, "use_multiview", False):
        render.use_multiview = False
        tell(note="stereoscopy is off: one view is rendered")


class CameraShift:
    """The camera's lens shift: the artist's own of each frame, with the jitter added.

    It is keyed on every frame (of the scene in memory), because rendering evaluates the animation again.
    Blender's Vector pass holds no move of the shift, neither the jitter's nor an animated one's.
    """

    def __init__(self, scene: Any, frames: list[int]) -> None:
        self.scene = scene
        if scene.camera.library is not None or scene.camera.data.library is not None:
            scene.camera = own_copy(scene, scene.camera)
        self.data = scene.camera.data
        animated = self.data.animation_data is not None
        self.own = {number: self._read(number) for number in (frames if animated else frames[:1])}
        self.constant = None if animated else self.own[frames[0]]
        for name in ("shift_x", "shift_y"):
            if animated:
                self.data.driver_remove(name)

    def set(self, number: int, jitter: list[float]) -> tuple[float, float]:
        """Go to a frame, add the jitter, and return the shift without it; both in render pixels."""
        x, y = self.constant or self.own[number]
        unit = self._pixels()
        self.data.shift_x, self.data.shift_y = x + jitter[0] / unit, y - jitter[1] / unit
        for name in ("shift_x", "shift_y"):
            self.data.keyframe_insert(name, frame=number)
        self.scene.frame_set(number)
        return x * unit, y * unit

    def _read(self, number: int) -> tuple[float, float]:
        self.scene.frame_set(number)
        data = self.scene.camera.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        return data.shift_x, data.shift_y

    def _pixels(self) -> float:
        """Return how many render pixels a shift of 1 is: the side that the sensor fits."""
        render = self.scene.render
        width, height = render.resolution_x, render.resolution_y
        aspect = render.pixel_aspect_y / render.pixel_aspect_x
        if self.data.sensor_fit == "AUTO":
            return width if width >= height * aspect else height * aspect
        return width if self.data.sensor_fit == "HORIZONTAL" else height * aspect


def own_copy(scene: Any, camera: Any) -> Any:
    """Return a copy of a linked camera, which Blender does not let anybody change."""
    copied = camera.copy()
    copied.data = camera.data.copy()
    scene.collection.objects.link(copied)
    return copied


def render(scene: Any, path: Path) -> None:
    """Render the present frame into a file that appears whole."""
    part = path.with_suffix(".part.exr")
    scene.render.filepath = str(part)
    bpy.ops.render.render(write_still=True, scene=scene.name)
    part.replace(path)


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


def facts(scene: Any, frames: list[int]) -> dict[str, object]:
    """Return what the reader of the frames needs to know of the scene."""
    render, view = scene.render, scene.view_settings
    return {
        "name": scene.name,
        "blender": bpy.app.version_string,
        "frames": frames,
        "frame_rate": render.fps / render.fps_base,
        "render_size": [render.resolution_x, render.resolution_y],
        "engine": render.engine,
        "layers": [layer.name for layer in scene.view_layers if layer.use],
        "view": {
            "display": scene.display_settings.display_device, "view": view.view_transform, "look": view.look,
            "exposure": view.exposure, "gamma": view.gamma,
        },
        "ocio": str(Path(bpy.utils.system_resource("DATAFILES")) / "colormanagement" / "config.ocio"),
    }  # fmt: skip


def named(items: Any) -> str:
    """Return names with commas between."""
    return ", ".join(item.name for item in items) or "none"


if __name__ == "__main__":
    try:
        main(json.loads(Path(sys.argv[-1]).read_text(encoding="utf-8")))
    except (SceneError, RuntimeError) as error:  # Blender's operators raise RuntimeError
        tell(error=" ".join(str(error).split()))
        sys.exit(1)
