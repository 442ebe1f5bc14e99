"""Run the compositor of a .blend file on finished frames, and add motion blur and depth of field to them.

Runs inside Blender, as render_frames.py does, with the same messages: {"note": ...} for a changed setting,
{"frame": number, "extension": ...} for each composited frame, {"error": ...}. Nothing is rendered: image
nodes take the place of the Render Layers nodes. The .blend file is never saved.
"""

import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
import render_frames  # type: ignore[import-not-found]
from render_frames import BlenderSceneError, choose_camera, chosen_scene, named, open_scene, report, run

import bpy  # isort: skip  # render_frames reports where it is missing

MAX_BLUR = 64.0  # pixels of the depth of field
NOISY = (
    "Noisy Image"  # pass that many compositors denoise; from the render, it would not be denoised over time
)


def main(settings: dict[str, Any]) -> None:
    """Composite with these settings.

    Args:
        settings: "blend": file to open; "scene": name of a scene; "camera": see render_frames.py; "layer":
            the rendered view layer; "size": [width, height] of the frames; "first", "last": their numbers;
            "results": folder of the finished frames, 0001.exr and so on; "renders": folder of the rendered
            ones, whose passes have the same size, or null; "composite": whether the file's compositor runs;
            "motion_blur", "depth_of_field": whether it is added; "folder" to write to; "run": part of the
            files' temporary names; "token": begins each message.
    """
    open_scene(settings["blend"])
    scene = chosen_scene(settings["scene"])
    render_frames.make_local(scene)
    choose_camera(scene, settings["camera"])
    layer = settings["layer"]
    tree = render_frames.compositor_of(scene, layer) if settings["composite"] else new_tree(scene)
    frames = FrameImages(tree, settings)
    image = frames.socket("Image")
    if settings["motion_blur"]:
        image = add_motion_blur(scene, tree, frames, image)
    defocus = None
    if settings["depth_of_field"]:
        defocus = add_depth_of_field(scene, tree, frames, image)
        image = defocus.outputs["Image"]
    replace_render_layers(tree, frames, image)
    read_cryptomatte_from_files(tree, frames)
    extension = set_output(scene, tree, settings["size"])
    for number in range(settings["first"], settings["last"] + 1):
        scene.frame_set(number)
        frames.load(number)
        if defocus is not None:
            follow_camera(defocus, scene.camera)
        name = f".{number:04d}.{settings['run']}.partial{extension}"
        render_frames.render(scene, Path(settings["folder"]) / name)
        report(frame=number, extension=extension)


def new_tree(scene: Any) -> Any:
    """Replace the scene's compositor nodes by a Render Layers node and an output."""
    if hasattr(scene, "compositing_node_group"):  # Blender 5
        tree = bpy.data.node_groups.new("Blur", "CompositorNodeTree")
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        scene.compositing_node_group = tree
        for effect in getattr(scene, "compositor_effects", ()):  # Blender 5.3
            effect.enable_for_render = effect.node_group == tree
        output = tree.nodes.new("NodeGroupOutput")
    else:
        scene.use_nodes = True
        tree = scene.node_tree
        tree.nodes.clear()
        output = tree.nodes.new("CompositorNodeComposite")
    layers = tree.nodes.new("CompositorNodeRLayers")
    tree.links.new(layers.outputs["Image"], output.inputs["Image"])
    scene.render.use_compositing = True
    return tree


def _name(number: int) -> str:
    return f"{number:04d}.exr"


class FrameImages:
    """Image nodes of the files of a frame: the results, and the render for passes that results lack.

    The first frame is loaded.
    """

    def __init__(self, tree: Any, settings: dict[str, Any]) -> None:
        self._tree, self._layer = tree, settings["layer"]
        self._folders = [Path(folder) for folder in (settings["results"], settings["renders"]) if folder]
        files = [str(folder / _name(settings["first"])) for folder in self._folders]
        self._images = [bpy.data.images.load(file) for file in files]
        for image in self._images:
            image.colorspace_settings.is_data = True  # the results have the render's colour space
        self._nodes = [node for image in self._images for node in self._nodes_of(image)]

    @property
    def render(self) -> Any:
        """Image of the render, or None."""
        return self._images[1] if len(self._images) > 1 else None

    def load(self, number: int) -> None:
        """Load the files of a frame."""
        for folder, image in zip(self._folders, self._images, strict=True):
            image.filepath = str(folder / _name(number))
            image.reload()

    def socket(self, name: str) -> Any:
        """Return the socket that holds a pass: of the results, or of the render."""
        names = (name, "Combined") if name == "Image" else (name,)
        for node in self._nodes:
            for output in node.outputs:
                if output.enabled and output.name in names:
                    return output
        raise BlenderSceneError(f"the compositor needs the pass {name!r}, which no frame of full size has")

    def _nodes_of(self, image: Any) -> list[Any]:
        """Return a node for the channels without a layer, and one for those of the view layer, if any."""
        nodes = []
        for layer in (None, self._layer):
            node = self._tree.nodes.new("CompositorNodeImage")
            node.image = image
            try:
                if layer is not None:
                    node.layer = layer
            except TypeError:  # the file has no such layer
                self._tree.nodes.remove(node)
                continue
            nodes.append(node)
        return nodes


def add_motion_blur(scene: Any, tree: Any, frames: FrameImages, image: Any) -> Any:
    """Add Vector Blur with the scene's shutter; return the socket of the blurred image."""
    node = tree.nodes.new("CompositorNodeVecBlur")
    depth = "Depth" if "Depth" in node.inputs else "Z"  # before Blender 5
    tree.links.new(image, node.inputs["Image"])
    tree.links.new(frames.socket("Depth"), node.inputs[depth])
    tree.links.new(frames.socket("Vector"), node.inputs["Speed"])
    shutter = scene.render.motion_blur_shutter
    if "Shutter" in node.inputs:
        node.inputs["Shutter"].default_value = shutter
    else:  # before Blender 4.5, the blur's length is twice the factor
        node.factor = 0.5 * shutter
    return node.outputs["Image"]


def add_depth_of_field(scene: Any, tree: Any, frames: FrameImages, image: Any) -> Any:
    """Add Defocus, which reads the focus of the scene's camera; return the node."""
    node = tree.nodes.new("CompositorNodeDefocus")
    tree.links.new(image, node.inputs["Image"])
    tree.links.new(frames.socket("Depth"), node.inputs["Z"])
    node.scene, node.use_zbuffer, node.blur_max = scene, True, MAX_BLUR
    if hasattr(node, "use_preview"):  # before Blender 5
        node.use_preview = False
    return node


def follow_camera(defocus: Any, camera: Any) -> None:
    """Set the lens of the frame's camera; without depth of field nothing blurs."""
    focus = camera.data.dof
    defocus.mute = not focus.use_dof
    defocus.f_stop = focus.aperture_fstop


def replace_render_layers(tree: Any, frames: FrameImages, image: Any) -> None:
    """Replace all Render Layers nodes by the frames' files; `image` is the socket of the image.

    In Blender 5 the first socket of the tree's own input is the rendered image, too.
    """
    for node in list(tree.nodes):
        if node.type == "GROUP_INPUT":
            for link in list(node.outputs[0].links):
                tree.links.new(image, link.to_socket)
        if node.type != "R_LAYERS":
            continue
        used = [output for output in node.outputs if output.is_linked]
        if not node.mute and NOISY in [output.name for output in used]:
            report(note=f"node {node.name!r}: the results replace {NOISY}, too")
        for output in () if node.mute else used:
            source = image if output.name in ("Image", NOISY) else frames.socket(output.name)
            for link in list(output.links):
                tree.links.new(source, link.to_socket)
        tree.nodes.remove(node)


def read_cryptomatte_from_files(tree: Any, frames: FrameImages) -> None:
    """Let Cryptomatte nodes read the render's file; their mattes stay."""
    for node in tree.nodes:
        if node.type == "CRYPTOMATTE_V2" and node.source == "RENDER":
            if frames.render is None:
                raise BlenderSceneError(f"node {node.name!r} needs mattes, which no frame of full size has")
            name, mattes = node.layer_name, node.matte_id
            node.source, node.image = "IMAGE", frames.render
            node.layer_name, node.matte_id = name, mattes


def set_output(scene: Any, tree: Any, size: list[int]) -> str:
    """Set the size of the frames, and one image file for each; return the extension of its name."""
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = *size, 100
    render.use_border = render.use_sequencer = False
    render.use_file_extension, render.use_overwrite, render.use_placeholder = True, True, False
    if getattr(render, "use_multiview", False):
        render.use_multiview = False
    output = render.image_settings
    is_multilayer = output.file_format == "OPEN_EXR_MULTILAYER"  # its passes would be black: none is rendered
    if render.is_movie_format or is_multilayer:
        written = "OPEN_EXR" if is_multilayer else "PNG"
        report(note=f"the output is {output.file_format}: {written} images are written instead")
        depth, codec = output.color_depth, output.exr_codec
        if hasattr(output, "media_type"):  # Blender 5
            output.media_type = "IMAGE"
        output.file_format = written
        if is_multilayer:
            output.color_depth, output.exr_codec = depth, codec
    writers = [node for node in render_frames.all_nodes(tree) if node.type == "OUTPUT_FILE" and not node.mute]
    for node in writers:
        node.mute = True
    if writers:
        report(note=f"only the image of the output node is written, not those of {named(writers)}")
    return str(render.file_extension)


if __name__ == "__main__":
    run(main)
