"""Build a small scene in Blender and save it: python make_scene.py FILE.blend '{"camera_type": "ORTHO"}'.

A camera that turns, walks and shifts its lens above a floor, before a sky; a cube that moves. Options: see
`DEFAULTS`; `properties` are set as they are, such as {"scene.frame_step": 2}.
"""

import json
import random
import sys
from pathlib import Path
from typing import Any

import bpy

DEFAULTS: dict[str, Any] = {
    "camera_type": "PERSP",
    "size": [96, 64],
    "percentage": 100,
    "camera": True,
    "sensor_fit": "AUTO",
    "shift": [[0.02, -0.03], [0.12, 0.07]],  # of the lens, at the first and the last frame
    "lens": [35.0, 35.0],  # mm, likewise
    "markers": [],  # [frame, camera]; another camera is there besides, "Other"
    "still": False,  # nothing moves, not even the camera
    "falls": False,  # whether a cube falls by a simulation that is not baked
    "properties": {},
    "compositor": None,  # name of the view layer whose inverted image and depth the nodes read
    "script": "",  # Python that Blender is to run when it opens the file
    "working_space": None,  # linear space of the file, which Blender 5 lets one choose
    "linked": False,  # whether the file has an empty scene, and links this one from set.blend beside it
}
FIRST, LAST = 5, 10
OBJECTS = 14


def build(options: dict[str, Any]) -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples = "CYCLES", 1
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.view_layers[0].samples = 3  # other than the scene's and --samples
    scene.frame_start, scene.frame_end = FIRST, LAST
    scene.render.resolution_x, scene.render.resolution_y = options["size"]
    scene.render.resolution_percentage = options["percentage"]
    scene.world = bpy.data.worlds.new("World")
    scene.world.use_nodes = True
    sky = scene.world.node_tree.nodes.new("ShaderNodeTexChecker")  # seen when the camera turns
    sky.inputs["Scale"].default_value = 9.0
    background = scene.world.node_tree.nodes["Background"]
    scene.world.node_tree.links.new(sky.outputs["Color"], background.inputs["Color"])
    chance = random.Random(3)
    bpy.ops.mesh.primitive_plane_add(size=30, location=(0, 0, -1))
    paint(bpy.context.object, (0.6, 0.6, 0.6))
    for _ in range(OBJECTS):
        place = chance.uniform(-5, 5), chance.uniform(-5, 5), chance.uniform(-0.6, 1.5)
        bpy.ops.mesh.primitive_cube_add(size=chance.uniform(0.5, 1.2), location=place)
        paint(bpy.context.object, tuple(chance.random() for _ in range(3)))
    light = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    light.data.energy, light.rotation_euler = 3.0, (0.7, 0.2, 0.3)
    scene.collection.objects.link(light)
    if options["camera"]:
        add_camera(scene, options)
    if options["markers"]:
        add_markers(scene, options["markers"])
    if not options["still"]:
        move(bpy.data.objects["Cube.003"], "location", [(1.0, -2.0, 0.3), (2.0, -1.5, 0.5)])
    if options["falls"]:
        bpy.context.view_layer.objects.active = bpy.data.objects["Cube"]
        bpy.ops.rigidbody.object_add()
        scene.rigidbody_world.point_cache.frame_start = FIRST
    if options["compositor"]:
        add_compositor(scene, options["compositor"])
    if options["working_space"] and hasattr(bpy.data, "colorspace"):
        bpy.ops.wm.set_working_color_space(working_space=options["working_space"], convert_colors=True)
    if options["script"]:
        text = bpy.data.texts.new("startup.py")
        text.write(options["script"])
        text.use_module = True
    for name, value in options["properties"].items():
        holder, _, attribute = name.rpartition(".")
        target = scene
        for part in holder.split(".")[1:]:
            target = getattr(target, part)
        setattr(target, attribute, value)


def paint(item: Any, color: tuple[float, ...]) -> None:
    material = bpy.data.materials.new("Paint")
    material.use_nodes = True
    material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (*color, 1.0)
    item.data.materials.append(material)


def add_camera(scene: Any, options: dict[str, Any]) -> None:
    data = bpy.data.cameras.new("Camera")
    data.type = options["camera_type"]
    data.ortho_scale, data.sensor_fit = 11.0, options["sensor_fit"]
    camera = bpy.data.objects.new("Camera", data)
    scene.collection.objects.link(camera)
    scene.camera = camera
    moved = 0.0 if options["still"] else 1.0
    move(camera, "location", [(7.0, -7.0, 3.0), (7.0 - 0.5 * moved, -7.0 + 0.8 * moved, 3.0)])
    move(camera, "rotation_euler", [(1.35, 0.0, 0.78), (1.35 - 0.05 * moved, 0.0, 0.78 + 0.12 * moved)])
    first, last = options["shift"]
    move(data, "lens", options["lens"])
    if first == last:  # no animation of it
        data.shift_x, data.shift_y = first
        return
    move(data, "shift_x", [first[0], last[0]])
    move(data, "shift_y", [first[1], last[1]])


def add_markers(scene: Any, markers: list[Any]) -> None:
    other = bpy.data.objects.new("Other", bpy.data.cameras.new("Other"))
    scene.collection.objects.link(other)
    for frame, name in markers:
        scene.timeline_markers.new(name, frame=frame).camera = bpy.data.objects[name]


def add_compositor(scene: Any, layer: str) -> None:
    """Set a compositor that inverts the image, in Blender 4 the noisy one, views it, and writes a file."""
    scene.view_layers[0].use_pass_z = scene.cycles.use_denoising = True
    scene.view_layers[0].cycles.denoising_store_passes = True
    scene.view_layers[0].update_render_passes()
    tree, output = new_compositor(scene)
    nodes, link = tree.nodes, tree.links.new
    kinds = ("RLayers", "Invert", "Viewer", "Viewer")
    layers, invert, *viewers = (nodes.new(f"CompositorNode{kind}") for kind in kinds)
    for name, viewer in zip(("Noisy Image", "Depth"), viewers, strict=True):
        link(layers.outputs[name], viewer.inputs["Image"])
    image = layers.outputs["Noisy Image"]
    if output.type == "GROUP_OUTPUT":  # Blender 5, where the tree's input is the image of the render
        tree.interface.new_socket("Image", in_out="INPUT", socket_type="NodeSocketColor")
        image = nodes.new("NodeGroupInput").outputs["Image"]
    link(image, invert.inputs["Color"])
    link(invert.outputs["Color"], output.inputs["Image"])
    link(layers.outputs["Image"], add_writer(nodes).inputs["Image"])
    inside = bpy.data.node_groups.new("Group", "CompositorNodeTree")
    inside.interface.new_socket("Image", in_out="INPUT", socket_type="NodeSocketColor")
    inner = inside.nodes.new("NodeGroupInput")
    inside.links.new(inner.outputs["Image"], add_writer(inside.nodes).inputs["Image"])
    group = nodes.new("CompositorNodeGroup")
    group.node_tree = inside
    link(layers.outputs["Image"], group.inputs["Image"])
    if layer not in scene.view_layers:
        scene.view_layers.new(layer)
    layers.layer = layer
    written = scene.render.image_settings
    if hasattr(written, "media_type"):  # Blender 5
        written.media_type = "MULTI_LAYER_IMAGE"
    written.file_format, written.color_depth = "OPEN_EXR_MULTILAYER", "32"


def new_compositor(scene: Any) -> tuple[Any, Any]:
    """Return the scene's compositor tree, without nodes but the output, and that node."""
    if hasattr(scene, "compositing_node_group"):  # Blender 5
        tree = scene.compositing_node_group = bpy.data.node_groups.new("Compositor", "CompositorNodeTree")
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        return tree, tree.nodes.new("NodeGroupOutput")
    scene.use_nodes = True
    scene.node_tree.nodes.clear()
    return scene.node_tree, scene.node_tree.nodes.new("CompositorNodeComposite")


def add_writer(nodes: Any) -> Any:
    """Return a File Output node that writes to the folder `beside`."""
    writer = nodes.new("CompositorNodeOutputFile")
    if hasattr(writer, "file_output_items"):  # Blender 5
        writer.directory, writer.file_name = "//beside", "image"
        writer.file_output_items.new("RGBA", "Image")
    else:
        writer.base_path = "//beside"
    return writer


def move(item: Any, name: str, values: list[Any]) -> None:
    """Key a property at the first and the last frame; a property that does not change is set alone."""
    if values[0] == values[1]:
        setattr(item, name, values[0])
        return
    for frame, value in zip((FIRST, LAST), values, strict=True):
        setattr(item, name, value)
        item.keyframe_insert(name, frame=frame)


def link_from(path: str) -> None:
    """Save the scene to a file, and link it in an empty one."""
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(path, link=True) as (there, here):
        here.scenes = there.scenes


def main(path: str, options: dict[str, Any]) -> None:
    build(options)
    if options["linked"]:
        link_from(str(Path(path).with_name("set.blend")))
    bpy.ops.wm.save_as_mainfile(filepath=path)


if __name__ == "__main__":
    main(sys.argv[-2], {**DEFAULTS, **json.loads(sys.argv[-1])})
