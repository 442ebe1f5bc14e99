"""Denoise images by OIDN in Blender's compositor: python blender_denoise.py '[["16-{}.exr", "16.exr"], ...]'.

Each pair has the files of an image and its guides, where {} is image, albedo or normal, and of the result.
Prints the CPU seconds of each.
"""

import json
import sys
import time
from typing import Any

import bpy


def main(pairs: list[list[str]]) -> None:
    """Denoise each first file into the second."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.use_nodes = True
    tree = scene.node_tree
    tree.nodes.clear()
    denoise, composite = tree.nodes.new("CompositorNodeDenoise"), tree.nodes.new("CompositorNodeComposite")
    tree.links.new(denoise.outputs["Image"], composite.inputs["Image"])
    sources = {name: tree.nodes.new("CompositorNodeImage") for name in ("Image", "Albedo", "Normal")}
    for name, node in sources.items():
        tree.links.new(node.outputs["Image"], denoise.inputs[name])
    image: Any = scene.render.image_settings
    image.file_format, image.color_depth = "OPEN_EXR", "32"
    for source, result in pairs:
        for name, node in sources.items():
            node.image = bpy.data.images.load(source.format(name.lower()))
        scene.render.resolution_x, scene.render.resolution_y = sources["Image"].image.size
        scene.render.resolution_percentage, scene.render.filepath = 100, result
        before = time.process_time()  # of all threads
        bpy.ops.render.render(write_still=True)
        print(f"seconds {time.process_time() - before}", flush=True)


if __name__ == "__main__":
    main(json.loads(sys.argv[-1]))
