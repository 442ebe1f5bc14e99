"""Render the frames of a scene: small with jitter for upscaling, or at full size for denoising.

Runs inside Blender, without supersampler.

    SUPERSAMPLER_RENDER='{...}' blender --background --python-exit-code 1 --python render_frames.py

The environment variable holds the settings as JSON; see `main`. A line on stdout that begins with the token
of the settings is a message in JSON: {"note": ...} for a changed setting, {"scene": ...} once, {"frame":
number, "shift": ..., "camera": ..., "world": ...} for each rendered frame, {"error": ...} if the scene cannot
be rendered. The .blend file is never saved.
"""

import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

SETTINGS: dict[str, Any] = json.loads(os.environ.pop("SUPERSAMPLER_RENDER", "{}"))
"""Settings of the render. They are removed from the environment, which children of Blender inherit."""


def report(**content: object) -> None:
    """Print one message for the parent process, on a line of its own.

    Bytes of names and paths that are not UTF-8 become question marks.
    """
    sys.stdout.flush()
    line = f"\n{SETTINGS['token']}{json.dumps(content, ensure_ascii=False)}\n"
    os.write(1, line.encode(errors="replace"))


try:
    import bpy
except ImportError as error:
    report(error=f"{sys.executable} is not Blender, and cannot import bpy: {error}")
    sys.exit(1)

OLDEST = (3, 6)  # supported version of Blender
PASSES = ("use_pass_combined", "use_pass_z", "use_pass_vector")
SURFACE_PASSES = ("use_pass_normal", "use_pass_diffuse_color")  # for frames that are upscaled
SAMPLES = 16  # per pixel of small frames in Cycles; docs/tutorials/blender.md compares numbers
SCALE = 2.0  # display over render size of upscaled frames
CHANNEL_BYTES = 64  # of a channel's name in EXR files before Blender 5
EXACT_FILTER = ("BLACKMAN_HARRIS", 0.01)  # width in pixels, one position in effect; BOX is always 1 wide


class BlenderSceneError(Exception):
    """The scene cannot be rendered with these settings; the text says why and what to do."""


def main(settings: dict[str, Any]) -> None:
    """Render with these settings.

    Args:
        settings: the fields of `RenderRequest`, which render.py documents, as JSON values: null is None,
            "frames" [first, last] and "display_size" [width, height]. And "folder" to write to; "run": part
            of the files' temporary names; "token": begins each message; "complete": number of first frames
            that are already rendered; "jitter": [[x, y], ...] of successive frames, in render pixels, x
            right, y down, repeated.
    """
    open_scene(settings["blend"])
    scene = chosen_scene(settings["scene"])
    name = scene.name_full
    make_local(scene)
    choose_camera(scene, settings["camera"])
    if settings["engine"] is not None:
        choose_engine(scene, settings["engine"])
    if switches := camera_switches(scene):
        at = ", ".join(map(str, switches))
        report(note=f"markers switch cameras at frame {at}: the history is dropped there")
    denoise = chosen_denoising(scene, settings["denoise"], settings["scale"])
    layer = chosen_layer(scene, settings["view_layer"])
    check_name(layer, denoise)
    if settings["composite"]:
        compositor_of(scene, layer.name)
    set_engine(scene, layer, settings["samples"], denoise)
    if settings["most"] is not None and scene.render.engine == "CYCLES":
        set_trial(scene, settings["samples"], settings["seed"])
    set_blur(scene, keep=settings["keep_blur"], denoise=denoise)
    set_passes(scene, layer, denoise)
    scale = 1.0 if denoise == "temporal" else settings["scale"] or SCALE
    display_size = set_size(scene, settings["display_size"], settings["part"], scale)
    set_output(scene, denoise)
    if settings["frames"] is None and settings["most"] is None:
        check_step(scene)
    own = own_range(scene, settings["most"])
    first, last = settings["frames"] or own
    has_strokes = denoise == "temporal" and bool(strokes(scene, layer))
    report(scene=facts(scene, name, layer.name, own, display_size, denoise) | {"has_strokes": has_strokes})
    jitter = [(0.0, 0.0)] if denoise == "temporal" else settings["jitter"]
    shift, moved = CameraShift(scene, is_jittered=denoise != "temporal"), MovedObjects(scene)
    begins = max(0, settings["complete"] - 1)
    simulate(scene, first + begins)
    for index in range(begins, last + 1 - first):
        number = first + index
        own_shift = shift.go_to(number, jitter[index % len(jitter)])
        moved.warn()
        if index < settings["complete"]:  # the next frame's vectors lead to this one
            continue
        began = time.perf_counter()
        render(scene, Path(settings["folder"]) / f".{number:04d}.{settings['run']}.partial.exr")
        seconds = round(time.perf_counter() - began, 3)
        camera, world = camera_matrices(scene)
        report(frame=number, shift=own_shift, camera=camera, world=world, seconds=seconds)


def open_scene(blend: str) -> None:
    """Open a file, and report whether Python in it does not run."""
    if bpy.app.version < OLDEST:
        raise BlenderSceneError(f"Blender {bpy.app.version_string} is too old; use 3.6 or later")
    bpy.ops.wm.open_mainfile(filepath=blend, load_ui=False)
    if bpy.app.autoexec_fail:
        what = f"Python in the file is not run ({bpy.app.autoexec_fail_message})"
        report(note=f"{what}: Auto Run Python Scripts is off in Blender's preferences")
    if missing := missing_files():
        more = f" and {len(missing) - 8} more" if missing[8:] else ""
        report(note=f"files are missing, and frames lack what they hold: {', '.join(missing[:8])}{more}")


def missing_files() -> list[str]:
    """Return the paths of the file's libraries and images that do not exist."""
    libraries = [library for library in bpy.data.libraries if not library.packed_file]
    images = [
        image for image in bpy.data.images if image.source == "FILE" and image.users and not image.packed_file
    ]
    places = {bpy.path.abspath(item.filepath, library=item.library): item for item in libraries + images}
    return [item.filepath for place, item in places.items() if place and not Path(place).exists()]


def check_step(scene: Any) -> None:
    """Check that the scene renders every frame."""
    if scene.frame_step != 1:
        problem = f"the scene renders every {scene.frame_step}th frame, but motion is to the previous frame"
        raise BlenderSceneError(f"{problem}: pass --frames {scene.frame_start}-{scene.frame_end}")


def own_range(scene: Any, most: int | None) -> tuple[int, int]:
    """Return the numbers of the scene's first and last frame, or of `most` frames in the middle."""
    first, last = scene.frame_start, scene.frame_end
    if most is not None:
        first = max(first, (first + last - most + 1) // 2)
        last = min(first + most - 1, last)
    return first, last


def chosen_scene(name: str | None) -> Any:
    """Return the scene of that name, and make it the window's scene; None is the active scene.

    A linked scene may also be given with the name of its file: "Scene [set.blend]".
    """
    if name is None:
        return bpy.context.scene
    found = [scene for scene in bpy.data.scenes if name in (scene.name, scene.name_full)]
    if not found:
        raise BlenderSceneError(f"no scene is named {name!r}; the file has {named(bpy.data.scenes)}")
    if bpy.context.window is not None:
        bpy.context.window.scene = found[0]
    return found[0]


def make_local(scene: Any) -> None:
    """Make a linked scene editable, in memory; its objects stay linked."""
    if scene.library is not None:
        scene.make_local()


def choose_camera(scene: Any, name: str | None) -> None:
    """Activate the camera of that name; check that all used cameras are supported."""
    cameras = [item for item in scene.objects if item.type == "CAMERA"]
    if name is not None:
        found = [item for item in cameras if item.name == name]
        if not found:
            raise BlenderSceneError(f"no camera is named {name!r}; the scene has {named(cameras)}")
        for marker in scene.timeline_markers:
            marker.camera = None  # it would override the named camera
        scene.camera = found[0]  # after the markers, because each change of a marker activates a camera
    if not used_cameras(scene):
        hint = f"pass --camera, one of {named(cameras)}" if cameras else "add one"
        raise BlenderSceneError(f"scene {scene.name!r} has no active camera: {hint}")
    for camera in used_cameras(scene):
        kind = "panoramic" if camera.type == "CAMERA" else f"of type {camera.type}"
        if camera.type != "CAMERA" or camera.data.type not in ("PERSP", "ORTHO"):
            what = f"camera {camera.name!r} is {kind}, and cannot be jittered or followed"
            raise BlenderSceneError(f"{what}; use a perspective or orthographic one")


def camera_markers(scene: Any) -> list[Any]:
    """Return the markers that activate a camera, in order."""
    markers = [item for item in scene.timeline_markers if item.camera and not item.camera.hide_render]
    return sorted(markers, key=lambda item: item.frame)


def used_cameras(scene: Any) -> list[Any]:
    """Return the cameras of the markers, or the active camera if no marker has one; [] without a camera."""
    cameras = [marker.camera for marker in camera_markers(scene)] or [scene.camera]
    return list({camera.name_full: camera for camera in cameras if camera is not None}.values())


def camera_switches(scene: Any) -> list[int]:
    """Return the numbers of the frames at which a marker switches to another camera, in remapped time."""
    pairs, old, new = pairwise(camera_markers(scene)), scene.render.frame_map_old, scene.render.frame_map_new
    return [-(-marker.frame * new // old) for before, marker in pairs if marker.camera != before.camera]


def chosen_denoising(scene: Any, denoise: str | None, scale: float | None) -> str:
    """Return "temporal", "frame" or "off"; by default temporal in Cycles, but "frame" with a scale."""
    if scene.render.engine == "CYCLES":
        return denoise or ("temporal" if scale is None else "frame")
    if denoise == "temporal":
        problem = f"engine {scene.render.engine} has no noise that temporal denoising could remove"
        raise BlenderSceneError(f"{problem}: leave --denoise out, or use --engine cycles")
    return "off"


def chosen_layer(scene: Any, name: str | None) -> Any:
    """Return the view layer of that name, by default the first one that is on; turn the others off."""
    layers = [each for each in scene.view_layers if (each.use if name is None else each.name == name)]
    if not layers and name is not None:
        what = f"no view layer is named {name!r}; scene {scene.name!r} has {named(scene.view_layers)}"
        raise BlenderSceneError(what)
    if not layers:
        raise BlenderSceneError(f"all view layers of scene {scene.name!r} are off: turn one on")
    if layers[1:]:
        what = f"view layer {layers[0].name!r} is rendered, not {named(layers[1:])}"
        report(note=f"{what}; --view-layer renders another one")
    for each in scene.view_layers:
        each.use = each == layers[0]
    return layers[0]


def check_name(layer: Any, denoise: str) -> None:
    """Check that the names of the needed channels, which begin with the view layer's, are not cut off."""
    longest = ".Denoising Albedo.R" if denoise == "temporal" else ".Combined.R"
    most, own = CHANNEL_BYTES - len(longest), len(layer.name.encode())
    if bpy.app.version < (5, 0) and own > most:
        problem = f"the name of view layer {layer.name!r} has {own} bytes; want at most {most}"
        raise BlenderSceneError(f"{problem}: before Blender 5, longer names of channels are cut off in EXR")


SIMULATIONS = ("CLOTH", "DYNAMIC_PAINT", "FLUID", "PARTICLE_SYSTEM", "SOFT_BODY")
"""Types of modifiers whose result depends on earlier frames."""


def simulates(scene: Any) -> bool:
    """Return whether the file has a simulation, baked or not."""
    modifiers = [modifier for item in bpy.data.objects for modifier in item.modifiers]
    return scene.rigidbody_world is not None or any(
        modifier.type in SIMULATIONS
        or (
            modifier.type == "NODES"
            and any(node.type == "SIMULATION_INPUT" for node in all_nodes(modifier.node_group))
        )
        for modifier in modifiers
    )


def simulate(scene: Any, number: int) -> None:
    """Step through the frames before a number: simulations that are not baked must run in order."""
    first = min(scene.frame_start, number)
    if first < number and simulates(scene):
        report(note=f"frames {first} to {number - 1} are simulated, not rendered")
        for each in range(first, number):
            scene.frame_set(each)


def set_engine(scene: Any, layer: Any, samples: int | None, denoise: str) -> None:
    """Set samples, denoising, and a narrow pixel filter in frames that are upscaled."""
    if scene.render.engine == "CYCLES":
        if layer.samples and scene.cycles.use_layer_samples != "IGNORE":
            most = scene.cycles.samples if scene.cycles.use_layer_samples == "BOUNDED" else layer.samples
            scene.cycles.samples = min(layer.samples, most)
        scene.cycles.use_layer_samples = "IGNORE"
        scene.cycles.use_animated_seed = True  # other noise in each frame, which is averaged over time
        scene.cycles.use_denoising = denoise != "off"
        if denoise == "temporal":
            set_full_size_cycles(scene, samples)
        else:
            set_small_cycles(scene, samples, denoise)
    elif scene.render.engine.startswith("BLENDER_EEVEE"):
        scene.render.filter_size = 0.0
        if samples is not None:
            scene.eevee.taa_render_samples = samples
    elif scene.render.engine == "BLENDER_WORKBENCH":
        if any(camera.data.type == "ORTHO" for camera in used_cameras(scene)):
            raise BlenderSceneError("Workbench writes no motion of orthographic cameras; use --engine eevee")
        scene.display.render_aa = "OFF"
    else:
        what = f"engine {scene.render.engine} is not supported"
        raise BlenderSceneError(f"{what}; use --engine cycles, eevee or workbench")


def set_full_size_cycles(scene: Any, samples: int | None) -> None:
    """Let OIDN denoise full-size frames, with the scene's own pixel filter."""
    if samples is not None:
        scene.cycles.samples = samples
    scene.cycles.denoiser = "OPENIMAGEDENOISE"
    scene.cycles.denoising_input_passes = "RGB_ALBEDO_NORMAL"
    scene.cycles.denoising_prefilter = "ACCURATE"  # the guides are noisy, especially behind glass
    what = f"Cycles renders at full size with {scene.cycles.samples} samples, and denoises"
    report(note=f"{what}; --scale 2 renders small and upscales instead")


def set_trial(scene: Any, samples: int | None, seed: int) -> None:
    """Set another seed, a fixed number of samples, and nothing that noisy colours lack."""
    if scene.cycles.use_adaptive_sampling and samples is None:
        problem = f"the scene samples adaptively, up to {scene.cycles.samples} times"
        raise BlenderSceneError(f"{problem}: pass --samples, the number to try")
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.driver_remove("seed")  # such as #frame
    scene.cycles.seed += seed
    for item in pencils(scene.objects):
        item.hide_render = True
    scene.render.use_freestyle = False


def pencils(objects: Any) -> list[Any]:
    """Return the Grease Pencil objects that are rendered."""
    kinds = ("GREASEPENCIL", "GPENCIL")  # since Blender 4.3, and before it
    return [item for item in objects if item.type in kinds and not item.hide_render]


def strokes(scene: Any, layer: Any) -> list[str]:
    """Return the names of Grease Pencil objects, and "Freestyle": Blender adds strokes after denoising."""
    lines = scene.render.use_freestyle and getattr(layer, "use_freestyle", False)
    names = [item.name for item in pencils(layer.objects)] + ["Freestyle"] * lines
    if names:
        report(
            note=f"{', '.join(names)}: Blender adds these strokes after Cycles has denoised a frame. "
            "Denoised frames are averaged over time here, instead of noisy ones"
        )
    return names


def set_small_cycles(scene: Any, samples: int | None, denoise: str) -> None:
    """Sample each pixel at one position, a fixed number of times."""
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = EXACT_FILTER
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.samples = SAMPLES if samples is None else samples
    scene.cycles.denoising_prefilter = "NONE"  # at one position per pixel OIDN's guides have no noise
    if samples is None:
        what = f"{scene.cycles.samples} samples, {'not ' if denoise == 'off' else ''}denoised"
        report(note=f"Cycles renders {what}; --samples and --denoise off change it")


def set_blur(scene: Any, *, keep: bool, denoise: str) -> None:
    """Turn motion blur and depth of field off; `keep` leaves them in frames that are denoised."""
    focused = [camera for camera in used_cameras(scene) if camera.data.dof.use_dof]
    if keep and denoise != "temporal":
        problem = "--keep-blur is for temporal denoising, in Cycles without --scale"
        raise BlenderSceneError(f"{problem}: blurred frames cannot be upscaled")
    if keep:
        if scene.render.use_motion_blur:
            lost = "Cycles then writes no vectors, and moving objects are denoised less over time"
            report(note=f"motion blur is kept: {lost}")
        if focused:
            report(note="depth of field is kept: areas out of focus are denoised less over time")
        return
    why = "cannot be reprojected"
    ways = "; --keep-blur keeps it, {} adds it to the results" if denoise == "temporal" else ""
    if scene.render.use_motion_blur:
        scene.render.use_motion_blur = False
        report(note=f"motion blur is off: blurred frames {why}{ways.format('--motion-blur')}")
    for camera in focused:
        focus = camera.data.dof
        focus.use_dof = False
        focus.driver_remove("use_dof")
        focus.driver_add("use_dof").driver.type = "SUM"  # of nothing: it stays off where it is animated
    if focused:
        report(note=f"depth of field is off: blurred depth and motion {why}{ways.format('--depth-of-field')}")


def choose_engine(scene: Any, engine: str) -> None:
    """Select cycles, eevee or workbench; Blender's names of them depend on its version."""
    names = {
        "cycles": ("CYCLES",),
        "eevee": ("BLENDER_EEVEE_NEXT", "BLENDER_EEVEE"),
        "workbench": ("BLENDER_WORKBENCH",),
    }
    for name in names[engine]:
        try:
            scene.render.engine = name
        except TypeError:  # this version of Blender has no such engine
            continue
        return
    raise BlenderSceneError(f"this Blender has no engine {engine}")


def set_passes(scene: Any, layer: Any, denoise: str) -> None:
    """Enable the passes that are read."""
    is_temporal = denoise == "temporal"
    for name in (*PASSES, *(() if is_temporal else SURFACE_PASSES)):
        if hasattr(layer, name):
            setattr(layer, name, True)
    if is_temporal:
        layer.cycles.denoising_store_passes = True
        layer.use_pass_vector = not scene.render.use_motion_blur  # with blur it is zero
    if denoise != "off":
        layer.cycles.use_denoising = True


def set_size(scene: Any, display_size: list[int] | None, part: float, scale: float) -> tuple[int, int]:
    """Set the render size to display size / scale; return the display size, by default the scene's * part."""
    render = scene.render
    own = (
        extent * render.resolution_percentage // 100 for extent in (render.resolution_x, render.resolution_y)
    )
    width, height = display_size or (max(4, round(extent * part)) for extent in own)
    if render.use_border:
        render.use_border = False
        report(note="the render border is off: whole frames are rendered")
    render.resolution_x, render.resolution_y = max(4, round(width / scale)), max(4, round(height / scale))
    render.resolution_percentage = 100
    return width, height


def set_output(scene: Any, denoise: str) -> None:
    """Set lossless multilayer EXR of floats, without compositing."""
    render, image = scene.render, scene.render.image_settings
    if hasattr(image, "media_type"):  # Blender 5
        image.media_type = "MULTI_LAYER_IMAGE"
    image.file_format, image.color_depth, image.exr_codec = "OPEN_EXR_MULTILAYER", "32", "ZIP"
    image.color_management = "FOLLOW_SCENE"  # pixels are not converted to another colour space
    render.use_file_extension, render.use_overwrite, render.use_placeholder = True, True, False
    if render.use_compositing and compositors_of(scene):
        frames = "denoised" if denoise == "temporal" else "upscaled"
        report(note=f"compositing is off in the render; --composite runs it on the {frames} frames")
    editor = scene.sequence_editor
    strips = editor and (getattr(editor, "strips", None) or getattr(editor, "sequences", None))
    if render.use_sequencer and strips:
        report(note="the sequencer is off: the scene itself is rendered")
    render.use_sequencer = render.use_compositing = False
    if getattr(render, "use_multiview", False):
        render.use_multiview = False
        report(note="stereoscopy is off: one view is rendered")
    if render.use_stamp:
        render.use_stamp = False  # the text would be averaged over time
        report(note="metadata is not burned into the frames; it is burned into composited ones")
    view = scene.view_settings
    if view.use_curve_mapping or getattr(view, "use_white_balance", False):
        report(note="curves and white balance of the colour management are not applied to png and mp4")


def compositors_of(scene: Any) -> list[Any]:
    """Return the node trees of a scene's compositor; Blender 5.3 and later run several, one after another."""
    if hasattr(scene, "compositor_effects"):
        return [
            each.node_group for each in scene.compositor_effects if each.enable_for_render and each.node_group
        ]
    if hasattr(scene, "compositing_node_group"):  # Blender 5
        return [scene.compositing_node_group] if scene.compositing_node_group else []
    return [scene.node_tree] if scene.use_nodes else []


def compositor_of(scene: Any, layer: str) -> Any:
    """Return the scene's compositor nodes, after checking that they can run on frames of one view layer."""
    trees = compositors_of(scene)
    if not trees or not scene.render.use_compositing:
        raise BlenderSceneError(f"scene {scene.name!r} has no compositor nodes, or Compositing is off")
    if len(trees) > 1:
        problem = f"scene {scene.name!r} has several compositor effects: {named(trees)}"
        raise BlenderSceneError(f"{problem}; join their nodes in one, or turn all but one off for renders")
    for node in trees[0].nodes:
        if node.type == "GROUP" and any(inner.type == "R_LAYERS" for inner in all_nodes(node.node_tree)):
            raise BlenderSceneError(f"group {node.name!r} has a Render Layers node: move it out of the group")
        if node.type != "R_LAYERS" or node.mute or not any(output.is_linked for output in node.outputs):
            continue
        if node.layer != layer or node.scene not in (None, scene):
            problem = f"node {node.name!r} reads view layer {node.layer!r}, but {layer!r} is rendered"
            raise BlenderSceneError(problem)
    return trees[0]


def all_nodes(tree: Any) -> Iterator[Any]:
    """Yield the nodes of a tree and of its groups; `tree` may be None, for an empty group."""
    for node in tree.nodes if tree else ():
        yield node
        if node.type == "GROUP":
            yield from all_nodes(node.node_tree)


class CameraShift:
    """Lens shift of the cameras: the scene's own in each frame, plus the jitter.

    Blender's Vector pass contains no motion of the shift, of jitter or of animation.
    """

    def __init__(self, scene: Any, *, is_jittered: bool) -> None:
        self.scene = scene
        self.own: dict[Any, Any] = {}  # copies of the cameras with the animated shift, by the cameras' data
        self.curves: dict[Any, list[Any]] = {}
        for camera in used_cameras(scene) if is_jittered else ():
            is_linked = camera.library is not None or camera.data.library is not None
            data = (replace_linked(scene, camera) if is_linked else camera).data
            if data not in self.own:
                self.own[data] = copied(scene, camera)
                self.curves[data] = [shift_curve(scene, data, name) for name in ("shift_x", "shift_y")]

    def go_to(self, number: int, jitter: tuple[float, float]) -> tuple[float, float]:
        """Go to a frame, add the jitter, and return the shift without it; both in render pixels."""
        self.scene.frame_set(number)  # markers activate the camera
        camera = self.scene.camera
        own = self.own.get(camera.data, camera).evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        (x, y), (unit_x, unit_y) = (own.shift_x, own.shift_y), self._pixels(camera.data)
        values = x + jitter[0] / unit_x, y - jitter[1] / unit_y
        for curve, value in zip(self.curves.get(camera.data, ()), values, strict=False):
            curve.keyframe_points.insert(number, value)
        if self.curves:
            self.scene.frame_set(number)
        return x * unit_x, y * unit_y

    def _pixels(self, data: Any) -> tuple[float, float]:
        """Return the render pixels of a shift of 1 in x and y: the side that the sensor is fitted to."""
        render = self.scene.render
        width, height = render.resolution_x, render.resolution_y
        aspect = render.pixel_aspect_y / render.pixel_aspect_x
        fit = data.sensor_fit
        is_wide = width >= height * aspect if fit == "AUTO" else fit == "HORIZONTAL"
        side = width if is_wide else height * aspect
        return side, side / aspect


def shift_curve(scene: Any, data: Any, name: str) -> Any:
    """Drive a property by the number of the frame, whatever else animates it; return the curve of its values.

    Keys in an action could be locked, linked, changed by modifiers, or moved by time remapping.
    """
    data.driver_remove(name)
    curve = data.driver_add(name)
    curve.driver.type = "SUM"
    target = curve.driver.variables.new().targets[0]
    target.id_type, target.id, target.data_path = "SCENE", scene, "frame_current"
    for modifier in list(curve.modifiers):  # in Blender 4 there is one, which takes the place of keys
        curve.modifiers.remove(modifier)
    curve.keyframe_points.clear()  # in Blender 5 there are two
    return curve


def copied(scene: Any, camera: Any) -> Any:
    """Return a copy of a camera and its data, in the scene."""
    copy = camera.copy()
    copy.data = camera.data.copy()
    scene.collection.objects.link(copy)
    return copy


def replace_linked(scene: Any, camera: Any) -> Any:
    """Replace a linked camera, which is read-only, by a copy, and return that."""
    copy = copied(scene, camera)
    for marker in scene.timeline_markers:
        if marker.camera == camera:
            marker.camera = copy
    if scene.camera == camera:
        scene.camera = copy
    return copy


class MovedObjects:
    """Warns of moving objects in frames without their motion.

    Workbench writes no Vector pass, and that of Cycles is wrong while an orthographic camera moves.
    """

    def __init__(self, scene: Any) -> None:
        self.scene = scene
        self.before: dict[str, Any] | None = None  # matrices of the previous frame
        self.seen_from: tuple[str, Any, float] | None = None  # its camera
        self.is_workbench = scene.render.engine == "BLENDER_WORKBENCH"
        is_parallel = any(camera.data.type == "ORTHO" for camera in used_cameras(scene))
        self.is_active = self.is_workbench or (scene.render.engine == "CYCLES" and is_parallel)
        if self.is_workbench:
            report(note="Workbench writes no Vector pass: only the camera's motion is known")

    def warn(self) -> None:
        """Compare the current frame with the previous one; warn at most once."""
        if not self.is_active:
            return
        depsgraph = bpy.context.evaluated_depsgraph_get()
        camera = self.scene.camera.evaluated_get(depsgraph)
        seen_from = self.scene.camera.name, camera.matrix_world.copy(), camera.data.ortho_scale
        now = {
            item.name: item.evaluated_get(depsgraph).matrix_world.copy()
            for item in self.scene.objects
            if item.type not in ("CAMERA", "LIGHT", "EMPTY") and not item.hide_render
        }
        moved = [name for name in now if self.before and self.before.get(name) not in (None, now[name])]
        is_cut = self.seen_from is None or self.seen_from[0] != seen_from[0]
        is_wrong = self.is_workbench or (camera.data.type == "ORTHO" and seen_from != self.seen_from)
        self.before, self.seen_from = now, seen_from
        if moved and is_wrong and not is_cut:
            what = f"objects move, and will blur: {', '.join(moved[:8])}"
            why = (
                ""
                if self.is_workbench
                else "; Cycles has no motion of them while an orthographic camera moves"
            )
            report(note=f"{what}{why}; --engine eevee has their motion")
            self.is_active = False


def render(scene: Any, path: Path) -> None:
    """Render the current frame to a file."""
    name, setting = str(path), scene.render.bl_rna.properties["filepath"]
    if getattr(setting, "is_path_supports_templates", False):  # since Blender 4.5, {name} is a variable
        name = name.replace("{", "{{").replace("}", "}}")
    scene.render.filepath = name
    bpy.ops.render.render(write_still=True, scene=scene.name)


def camera_matrices(scene: Any) -> tuple[list[list[float]], list[list[float]]]:
    """Return projection @ view with the current shift, and camera to world, of the current frame.

    Clip space is from -1 to 1.
    """
    depsgraph = bpy.context.evaluated_depsgraph_get()
    camera = scene.camera.evaluated_get(depsgraph)
    render = scene.render
    projection = camera.calc_matrix_camera(
        depsgraph, x=render.resolution_x, y=render.resolution_y,
        scale_x=render.pixel_aspect_x, scale_y=render.pixel_aspect_y,
    )  # fmt: skip
    world = camera.matrix_world.normalized()
    return [list(row) for row in projection @ world.inverted()], [list(row) for row in world]


def facts(
    scene: Any, name: str, layer: str, numbers: tuple[int, int], display_size: tuple[int, int], denoise: str
) -> dict[str, object]:
    """Return the properties of the scene that the reader of the frames needs; `name` is that in the file."""
    render, view = scene.render, scene.view_settings
    own = Path(bpy.utils.system_resource("DATAFILES"))
    space = getattr(bpy.data, "colorspace", None)  # Blender 5: the file has its own linear space
    return {
        "name": name,
        "blender": bpy.app.version_string,
        "numbers": numbers,
        "frame_rate": render.fps / render.fps_base,
        "render_size": [render.resolution_x, render.resolution_y],
        "display_size": display_size,
        "samples": scene.cycles.samples if render.engine == "CYCLES" else None,
        "denoise": denoise,
        "cuts": camera_switches(scene),
        "engine": render.engine,
        "layer": layer,
        "view": {
            "display": scene.display_settings.display_device, "view": view.view_transform, "look": view.look,
            "exposure": view.exposure, "gamma": view.gamma,
        },
        "ocio": os.environ.get("OCIO") or str(own / "colormanagement" / "config.ocio"),
        **({"linear": space.working_space, "interop_id": space.working_space_interop_id} if space else {}),
    }  # fmt: skip


def named(items: Any) -> str:
    """Return names, comma-separated, or "none"."""
    return ", ".join(getattr(item, "name_full", item.name) for item in items) or "none"


def run(script: Callable[[dict[str, Any]], None]) -> None:
    """Call the `main` of a script with the settings; report its error, and exit."""
    try:
        script(SETTINGS)
    except (BlenderSceneError, RuntimeError) as error:  # Blender's operators raise RuntimeError
        report(error=" ".join(str(error).split()))
        sys.exit(1)


if __name__ == "__main__":
    run(main)
