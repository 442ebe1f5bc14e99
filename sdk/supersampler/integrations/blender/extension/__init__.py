"""Extension of Blender: a panel in the render properties, and operators that run the `supersampler` command.

The command is installed separately (`pip install supersampler`); the preferences hold its path.
"""

import sys
from pathlib import Path
from typing import Any

import bpy

from .run import Run, command_line, render_command

_TICK = 0.5  # seconds between updates of the progress


class SupersamplerPreferences(bpy.types.AddonPreferences):
    """Preferences: the path of the command."""

    bl_idname = __package__

    program: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Command", description="The supersampler command", subtype="FILE_PATH", default="supersampler"
    )

    def draw(self, _: Any) -> None:
        """Show the preferences."""
        self.layout.prop(self, "program")


class SupersamplerSettings(bpy.types.PropertyGroup):
    """Settings of a scene."""

    scale: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Scale", description="Size of the results divided by the render size", default=2, min=1, max=4
    )
    samples: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Samples",
        description="Samples per render pixel; 0: the scene's, or 16 if Cycles' frames are upscaled",
        default=0,
        min=0,
    )
    image_format: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Format",
        items=[("exr", "OpenEXR", "Linear, half float"), ("png", "PNG", "As the view transform shows it")],
    )
    output: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Output", description="Folder of the results", subtype="DIR_PATH", default="//supersampled/"
    )
    source: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Frames", description="Folder of rendered frames", subtype="DIR_PATH"
    )
    overwrite: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Overwrite", description="Replace the results of an earlier run"
    )


class _RunsCommand:
    """Runs a command, in the foreground if Blender has no window, otherwise in the background."""

    _run: Run
    _timer: Any = None

    def start(self, context: Any) -> Run:
        """Start the command; raise ValueError with the reason if that is not possible."""
        raise NotImplementedError

    def execute(self: Any, context: Any) -> set[str]:
        """Run the command until it ends."""
        if not self._begin(context):
            return {"CANCELLED"}
        while self._run.wait(_TICK):
            pass
        return self._end(context)  # type: ignore[no-any-return]

    def invoke(self: Any, context: Any, _: Any) -> set[str]:
        """Run the command in the background."""
        if not self._begin(context):
            return {"CANCELLED"}
        self._timer = context.window_manager.event_timer_add(_TICK, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self: Any, context: Any, event: Any) -> set[str]:
        """Show the progress; Escape ends the command."""
        if event.type == "ESC":
            self._run.cancel()
        elif event.type == "TIMER":
            if not self._run.pump():
                return self._end(context)  # type: ignore[no-any-return]
            done = f"Supersampler: {self._run.done} of {self._run.total} frames. Esc ends it."
            context.workspace.status_text_set(done)
        return {"PASS_THROUGH"}

    def _begin(self: Any, context: Any) -> bool:
        try:
            self._run = self.start(context)
        except (OSError, ValueError) as error:
            self.report({"ERROR"}, str(error))
            return False
        return True

    def _end(self: Any, context: Any) -> set[str]:
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            context.workspace.status_text_set(None)
        if self._run.error:
            self.report({"ERROR"}, self._run.error)
            return {"CANCELLED"}
        self.report({"INFO"}, f"{self._run.done} of {self._run.total} frames are complete")
        return {"FINISHED"}


class SUPERSAMPLER_OT_render(_RunsCommand, bpy.types.Operator):
    """Render the animation of the saved file small, and upscale it."""

    bl_idname, bl_label = "supersampler.render", "Render Animation Supersampled"

    def start(self, context: Any) -> Run:
        """Start `supersampler blender`."""
        return _start_render(context, context.scene.supersampler.scale)


class SUPERSAMPLER_OT_render_denoised(_RunsCommand, bpy.types.Operator):
    """Render the animation of the saved file with Cycles, and denoise it over time."""

    bl_idname, bl_label = "supersampler.render_denoised", "Render Animation Denoised"

    def start(self, context: Any) -> Run:
        """Start `supersampler blender`."""
        return _start_render(context, None)


class SUPERSAMPLER_OT_upscale(_RunsCommand, bpy.types.Operator):
    """Upscale rendered frames with the passes Combined, Z and Vector."""

    bl_idname, bl_label = "supersampler.upscale", "Upscale Rendered Frames"

    def start(self, context: Any) -> Run:
        """Start `supersampler upscale`."""
        return _start_on_frames(context, "upscale", scale=context.scene.supersampler.scale)


class SUPERSAMPLER_OT_denoise(_RunsCommand, bpy.types.Operator):
    """Denoise rendered frames over time, with the passes Combined, Z, Vector, Normal and Denoising Data."""

    bl_idname, bl_label = "supersampler.denoise", "Denoise Rendered Frames"

    def start(self, context: Any) -> Run:
        """Start `supersampler denoise`."""
        return _start_on_frames(context, "denoise")


def _start_render(context: Any, scale: float | None) -> Run:
    """Start `supersampler blender`; raise ValueError if the file is not saved."""
    changed = bpy.data.is_dirty and not bpy.app.background  # in the background it is always dirty
    if not bpy.data.filepath or changed:
        raise ValueError("Save the file first: the last saved version is rendered")
    scene, settings = context.scene, context.scene.supersampler
    output = Path(bpy.path.abspath(settings.output))
    command = render_command(
        _program(context),
        bpy.data.filepath,
        output,
        blender=bpy.app.binary_path or sys.executable,
        frames=(scene.frame_start, scene.frame_end),
        scene=scene.name,
        scale=scale,
        samples=settings.samples,
        format=settings.image_format,
        overwrite=settings.overwrite,
    )
    return Run(command, output, scene.frame_end - scene.frame_start + 1)


def _start_on_frames(context: Any, name: str, **options: Any) -> Run:
    """Start a command on the folder of rendered frames; raise ValueError if there is no such folder."""
    settings = context.scene.supersampler
    folder, output = (Path(bpy.path.abspath(path)) for path in (settings.source, settings.output))
    if not settings.source or not folder.is_dir():
        raise ValueError("Choose the folder of the rendered frames")
    common = {"format": settings.image_format, "overwrite": settings.overwrite}
    command = command_line(_program(context), name, folder, output, **common, **options)
    return Run(command, output, sum(1 for _ in folder.glob("[!.]*.exr")))


class SUPERSAMPLER_PT_panel(bpy.types.Panel):
    """The panel in the render properties."""

    bl_label, bl_idname = "Supersample", "SUPERSAMPLER_PT_panel"
    bl_space_type, bl_region_type, bl_context = "PROPERTIES", "WINDOW", "render"

    def draw(self, context: Any) -> None:
        """Show settings and operators."""
        layout, settings = self.layout, context.scene.supersampler
        layout.use_property_split = True
        for name in ("scale", "samples", "image_format", "output", "overwrite"):
            layout.prop(settings, name)
        if context.scene.render.engine == "CYCLES":
            layout.operator(SUPERSAMPLER_OT_render_denoised.bl_idname)
        layout.operator(SUPERSAMPLER_OT_render.bl_idname)
        layout.prop(settings, "source")
        layout.operator(SUPERSAMPLER_OT_denoise.bl_idname)
        layout.operator(SUPERSAMPLER_OT_upscale.bl_idname)


_CLASSES = (
    SupersamplerPreferences,
    SupersamplerSettings,
    SUPERSAMPLER_OT_render,
    SUPERSAMPLER_OT_render_denoised,
    SUPERSAMPLER_OT_upscale,
    SUPERSAMPLER_OT_denoise,
    SUPERSAMPLER_PT_panel,
)


def register() -> None:
    """Add the extension to Blender."""
    for item in _CLASSES:
        bpy.utils.register_class(item)
    bpy.types.Scene.supersampler = bpy.props.PointerProperty(type=SupersamplerSettings)


def unregister() -> None:
    """Remove the extension from Blender."""
    del bpy.types.Scene.supersampler
    for item in reversed(_CLASSES):
        bpy.utils.unregister_class(item)


def _program(context: Any) -> str:
    return str(context.preferences.addons[__package__].preferences.program)
