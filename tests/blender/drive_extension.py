"""Install the extension's zip and call its operators, in Blender without a window.

drive_extension.py ZIP FILE.blend COMMAND OUTPUT: a line of JSON says what each call returned.
"""

import json
import shutil
import sys

import bpy

ZIP, BLEND, COMMAND, OUTPUT = sys.argv[-4:]


def called(operator: object) -> str:
    try:
        return ", ".join(operator())  # type: ignore[operator]
    except RuntimeError as error:  # a report of an error
        return str(error).strip()


bpy.ops.extensions.package_install_files(filepath=ZIP, repo="user_default", enable_on_install=True)
module = "bl_ext.user_default.supersampler"
bpy.context.preferences.addons[module].preferences.program = COMMAND
found = {"unsaved": called(bpy.ops.supersampler.render)}
bpy.ops.wm.open_mainfile(filepath=BLEND)
scene = bpy.context.scene
scene.supersampler.output, scene.supersampler.samples = OUTPUT, 1
scene.frame_start, scene.frame_end = 6, 7
bpy.ops.wm.save_mainfile()
found["render"] = called(bpy.ops.supersampler.render)
found["again"] = called(bpy.ops.supersampler.render)
scene.supersampler.samples = 2
bpy.ops.wm.save_mainfile()
found["other"] = called(bpy.ops.supersampler.render)
found["no source"] = called(bpy.ops.supersampler.upscale)
shutil.copytree(f"{OUTPUT}/render", f"{OUTPUT}/../frames")
scene.supersampler.source, scene.supersampler.output = f"{OUTPUT}/../frames", f"{OUTPUT}/../upscaled"
found["upscale"] = called(bpy.ops.supersampler.upscale)
scene.supersampler.output = f"{OUTPUT}/../denoised"
found["render denoised"] = called(bpy.ops.supersampler.render_denoised)
shutil.copytree(f"{OUTPUT}/../denoised/render", f"{OUTPUT}/../full", ignore=shutil.ignore_patterns("*.json"))
scene.supersampler.source, scene.supersampler.output = f"{OUTPUT}/../full", f"{OUTPUT}/../denoised again"
found["denoise"] = called(bpy.ops.supersampler.denoise)
bpy.context.preferences.addons[module].preferences.program = "/nowhere"
found["no command"] = called(bpy.ops.supersampler.upscale)
bpy.ops.preferences.addon_disable(module=module)
found["disabled"] = str(hasattr(bpy.types.Scene, "supersampler"))
print(json.dumps(found))
