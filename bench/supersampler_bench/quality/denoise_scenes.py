"""Render the animated scenes that `supersampler bench denoise` measures, with Cycles on the CPU.

    python denoise_scenes.py [SCENE ...] -o renders                 # a Python with bpy
    blender -b -P denoise_scenes.py -- [SCENE ...] -o renders

This writes frames, SCENE-SAMPLES/0001.exr ..., with the renderer's CPU seconds in costs.jsonl, and references
of a region of three frames, SCENE-reference1/0012.exr ...; the bench averages the files of a frame. The same
command resumes a stopped run. --variant changes objects, places and colours; the filter is fitted to those.
"""

import json
import random
import sys
import time
from argparse import ArgumentParser
from collections.abc import Callable, Sequence
from math import cos, pi, radians, sin
from pathlib import Path
from typing import Any, NamedTuple

import bpy
from mathutils import Vector

Triple = tuple[float, float, float]
SAMPLES, REFERENCE_SAMPLES, PART = (4, 1, 2, 8), 1024, 256
"""Samples per pixel: of frames, of references, and of each of the files whose mean is a reference."""
FRAMES = 24
REFERENCES = (12, 13, 14)  # frames, whose windows of eight frames to either side are complete
SIZE = (640, 360)
REFERENCE_SEED = 1000  # times the part: its noise is independent of that of the frames and the other parts


class Scene(NamedTuple):
    """A scene and the region of its references: left, right, bottom, top, as fractions of the image."""

    build: Callable[[random.Random], None]
    region: tuple[float, float, float, float]


def paint(color: Triple = (0.8, 0.8, 0.8), **values: Any) -> Any:
    """Return a material; `values` are inputs of the Principled BSDF, with _ for a space."""
    material = bpy.data.materials.new("Paint")
    material.use_nodes = True
    inputs = material.node_tree.nodes["Principled BSDF"].inputs
    for name, value in {"Base_Color": (*color, 1.0), "Roughness": 0.6, **values}.items():
        inputs[name.replace("_", " ")].default_value = value
    return material


def glass(color: Triple = (1.0, 1.0, 1.0)) -> Any:
    """Return a material of glass, of a paler colour."""
    red, green, blue = color
    pale = (0.6 + 0.4 * red, 0.6 + 0.4 * green, 0.6 + 0.4 * blue)
    return paint(pale, Roughness=0.0, IOR=1.45, Transmission_Weight=1.0)


def textured(kind: str, *, upright: bool = False, output: str = "Color", **values: Any) -> Any:
    """Return a material whose colour is a texture in object coordinates.

    Args:
        kind: type of the texture node, such as Brick.
        upright: the texture's plane is x and z of the object instead of x and y.
        output: of the node.
        values: inputs of the node.
    """
    material = paint()
    tree = material.node_tree
    texture, place, mapping = (
        tree.nodes.new(f"ShaderNode{name}") for name in (f"Tex{kind}", "TexCoord", "Mapping")
    )
    mapping.inputs["Rotation"].default_value = (-pi / 2.0 if upright else 0.0, 0.0, 0.0)
    for name, value in values.items():
        texture.inputs[name.replace("_", " ")].default_value = value
    tree.links.new(place.outputs["Object"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
    tree.links.new(texture.outputs[output], tree.nodes["Principled BSDF"].inputs["Base Color"])
    return material


def brick(first: Triple, second: Triple, *, upright: bool = True, scale: float = 2.5) -> Any:
    """Return a material of bricks, or planks, of two colours."""
    mortar = (0.6, 0.58, 0.55, 1.0)
    return textured(
        "Brick", upright=upright, Scale=scale, Color1=(*first, 1.0), Color2=(*second, 1.0), Mortar=mortar
    )


def checker(first: Triple, second: Triple, scale: float) -> Any:
    """Return a checkered material."""
    return textured("Checker", Color1=(*first, 1.0), Color2=(*second, 1.0), Scale=scale)


def shape(kind: str, place: Triple, material: Any, *, scale: Triple = (1.0, 1.0, 1.0), **options: Any) -> Any:
    """Add a mesh, such as cube or torus; `options` are those of Blender's operator."""
    getattr(bpy.ops.mesh, f"primitive_{kind}_add")(location=place, **options)
    item = bpy.context.object
    item.scale = scale
    bpy.ops.object.transform_apply(location=False, rotation=False, scale=True)
    if kind != "cube":
        bpy.ops.object.shade_smooth_by_angle(angle=radians(40.0))
    item.data.materials.append(material)
    return item


def box(size: Triple, place: Triple, material: Any, *, rotation: Triple = (0.0, 0.0, 0.0)) -> Any:
    """Add a box of these lengths of sides."""
    return shape("cube", place, material, scale=size, size=1.0, rotation=rotation)


def any_color(chance: random.Random) -> Triple:
    """Return a random colour."""
    return (chance.uniform(0.05, 0.9), chance.uniform(0.05, 0.9), chance.uniform(0.05, 0.9))


def light(kind: str, place: Triple, energy: float, **values: Any) -> Any:
    """Add a lamp: POINT, AREA or SUN; `values` are its other properties."""
    item = bpy.data.objects.new(kind, bpy.data.lights.new(kind, kind))
    for name, value in {"energy": energy, **values}.items():
        setattr(item.data, name, value)
    item.location = place
    bpy.context.scene.collection.objects.link(item)
    return item


def aimed(place: Vector, target: Vector) -> Any:
    """Return the rotation of a camera or lamp at `place` that looks at `target`."""
    return (target - place).to_track_quat("-Z", "Y").to_euler()


def animate(item: Any, name: str, value: Callable[[float], Sequence[float]]) -> None:
    """Key a property in every frame; time is 0 in the first one and 1 in the last."""
    for frame in range(FRAMES + 2):
        setattr(item, name, value((frame - 1) / (FRAMES - 1)))
        item.keyframe_insert(name, frame=frame)


def spin(item: Any, angle: float) -> None:
    """Turn an object around the vertical axis."""
    x, y, z = item.rotation_euler
    animate(item, "rotation_euler", lambda t: (x, y, z + angle * t))


def circle(phase: float, height: float) -> Callable[[float], Triple]:
    """Return a path between the columns of `lamps`."""
    return lambda t: (2.2 * cos(phase + 1.8 * t), 1.4 + 1.3 * sin(phase + 1.8 * t), height)


def camera(first: Triple, last: Triple, target: Triple, lens: float) -> None:
    """Add the camera, which moves along a line and looks at a point."""
    item = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    item.data.lens = lens
    bpy.context.scene.collection.objects.link(item)
    bpy.context.scene.camera = item
    begin, end, point = Vector(first), Vector(last), Vector(target)
    animate(item, "location", lambda t: begin.lerp(end, t))
    animate(item, "rotation_euler", lambda t: aimed(begin.lerp(end, t), point))


def sky(color: Triple, strength: float) -> None:
    """Set light of one colour from all around."""
    world = bpy.data.worlds.new("World")
    world.use_nodes = True
    inputs = world.node_tree.nodes["Background"].inputs
    inputs["Color"].default_value, inputs["Strength"].default_value = (*color, 1.0), strength
    bpy.context.scene.world = world


def turning(place: Triple, parts: Sequence[Any], rotation: Callable[[float], Triple]) -> None:
    """Attach parts, built around the origin, to a point, and turn them around it."""
    bpy.ops.object.empty_add(location=place)
    center = bpy.context.object
    for part in parts:
        part.parent = center
    animate(center, "rotation_euler", rotation)


def courtyard(chance: random.Random) -> None:
    """Brick, a fence of wire and slats, a wheel with thin spokes that turns, plants; the camera moves."""
    sky((0.55, 0.75, 1.0), 0.4)
    sun = light("SUN", (0, 0, 9), 4.0, angle=0.08)
    sun.rotation_euler = aimed(Vector((chance.uniform(-4, 4), -3, 6)), Vector((0, 2, 0)))
    box((30, 30, 0.1), (0, 0, -0.05), brick((0.3, 0.28, 0.25), (0.2, 0.2, 0.21), upright=False, scale=1.2))
    wall = brick((0.5, chance.uniform(0.15, 0.3), 0.15), (0.4, 0.14, 0.08))
    box((18, 0.3, 4), (0, 6, 2), wall)
    box((12, 0.3, 3), (-5, 0.5, 1.5), wall, rotation=(0, 0, pi / 2))
    box((1.2, 0.1, 2.2), (chance.uniform(-3, -2), 5.82, 1.1), paint((0.08, 0.12, 0.1), Roughness=0.2))
    wire = paint((0.5, 0.5, 0.52), Metallic=1.0, Roughness=0.35)
    for index in range(-22, 14):
        for lean in (-1, 1):
            place, tilt = (0.13 * index - 0.7, 1.0, 0.75), (0, lean * pi / 4, 0)
            shape("cylinder", place, wire, radius=0.006, depth=1.9, vertices=6, rotation=tilt)
    slat = paint((0.75, 0.72, 0.65))
    for index in range(16):
        box((0.07, 0.03, 1.5), (1.3 + 0.15 * index, 1.0, 0.75), slat)
    rim = shape("torus", (0, 0, 0), paint((0.1, 0.1, 0.1)), major_radius=0.8, minor_radius=0.035)
    rim.rotation_euler = (pi / 2, 0, 0)
    spokes = [
        shape("cylinder", (0, 0, 0), wire, radius=0.009, depth=1.6, vertices=8, rotation=(0, pi * k / 7, 0))
        for k in range(7)
    ]
    begin, speed = chance.uniform(0, pi), chance.choice((-1, 1)) * radians(4.0 * (FRAMES - 1))
    turning((0.35, 2.6, 0.85), [rim, *spokes], lambda t: (0, begin + speed * t, 0))
    for _ in range(14):
        x, y, size = chance.uniform(-4, 4), chance.uniform(2.8, 5.5), chance.uniform(0.2, 0.45)
        box((size, size, size), (x, y, size / 2), paint(any_color(chance)), rotation=(0, 0, chance.random()))
        leaves = paint((0.1, chance.uniform(0.25, 0.5), 0.08))
        for _ in range(5):
            turn = (chance.uniform(-0.5, 0.5), chance.uniform(-0.5, 0.5), 0)
            shape("cone", (x, y, 1.6 * size), leaves, radius1=0.05, depth=2 * size, vertices=6, rotation=turn)
    camera((-1.3, -4.6, 1.6), (0.3, -4.4, 1.7), (0.2, 2.2, 0.95), 35)


def room(chance: random.Random) -> None:
    """Light through a window, a fan, a ball that rolls, furniture; the camera moves."""
    sky((0.5, 0.7, 1.0), 1.0)
    sun = light("SUN", (0, 0, 9), 6.0, angle=0.02)
    sun.rotation_euler = aimed(Vector((-5, -2.5, chance.uniform(4.5, 5.5))), Vector((0, 0.5, 0.8)))
    window = light("AREA", (-3.1, 0.4, 1.6), 90.0, size=1.6, color=(0.8, 0.9, 1.0))
    window.rotation_euler = (0, -pi / 2, 0)
    plaster = paint((0.75, 0.72, 0.66))
    planks = brick((0.35, 0.2, 0.1), (0.5, 0.3, 0.16), upright=False, scale=1.5)
    box((6.2, 6.2, 0.1), (0, 0, -0.05), planks)
    box((6.2, 6.2, 0.1), (0, 0, 3.05), plaster)
    box((6.2, 0.1, 3), (0, 3.05, 1.5), textured("Voronoi", upright=True, output="Distance", Scale=5.0))
    box((6.2, 0.1, 3), (0, -3.05, 1.5), plaster)
    box((0.1, 6.2, 3), (3.05, 0, 1.5), plaster)
    for width, height, y, z in (
        (2.6, 3, -1.7, 1.5),
        (2, 3, 2.1, 1.5),
        (1.5, 0.8, 0.35, 0.4),
        (1.5, 0.6, 0.35, 2.7),
    ):
        box((0.1, width, height), (-3.05, y, z), plaster)
    for width, height in ((0.04, 1.6), (1.5, 0.04)):
        box((0.04, width, height), (-3.02, 0.35, 1.6), paint((0.9, 0.9, 0.9)))
    box((1.6, 0.9, 0.06), (0.6, 1.6, 0.75), paint(any_color(chance), Roughness=0.25))
    for x, y in ((-0.1, 1.25), (1.3, 1.25), (-0.1, 1.95), (1.3, 1.95)):
        box((0.06, 0.06, 0.72), (x, y, 0.36), paint((0.1, 0.1, 0.1)))
    things: tuple[tuple[str, dict[str, Any]], ...] = (
        ("uv_sphere", {"radius": 0.13}),
        ("cylinder", {"radius": 0.09, "depth": 0.26}),
        ("cone", {"radius1": 0.12, "depth": 0.26}),
    )
    for index in range(5):
        kind, options = chance.choice(things)
        place = (0.3 * index, chance.uniform(1.4, 1.9), 0.91)
        shape(kind, place, paint(any_color(chance), Roughness=0.3), **options)
    box((1.0, 0.05, 0.8), (-1.3, 2.98, 1.7), textured("Magic", upright=True, Scale=4.0))
    box((0.9, 1.8, 0.45), (-2.4, 1.9, 0.22), textured("Noise", Scale=5.0))
    blade = paint((0.5, 0.35, 0.2), Roughness=0.3)
    blades = [
        box((1.5, 0.16, 0.02), (0, 0, 0), blade, rotation=(radians(12), 0, 0)),
        box((1.5, 0.16, 0.02), (0, 0, 0), blade, rotation=(radians(12), 0, pi / 2)),
        shape("cylinder", (0, 0, 0.4), paint((0.2, 0.2, 0.2), Metallic=1.0), radius=0.05, depth=0.9),
    ]
    turning((-0.3, 1.0, 2.15), blades, lambda t: (0, 0, radians(13.0 * (FRAMES - 1)) * t))
    ball = checker(any_color(chance), (0.9, 0.9, 0.85), 6.0)
    item = shape("uv_sphere", (0, 0, 0), ball, radius=0.28, segments=48, ring_count=24)
    begin, way = chance.uniform(-2.0, -1.6), chance.uniform(1.4, 1.8)
    animate(item, "location", lambda t: (begin + way * t, 0.5, 0.28))
    animate(item, "rotation_euler", lambda t: (0.4, way * t / 0.28, 0))
    camera((2.5, -2.6, 1.6), (2.1, -2.7, 1.55), (-0.6, 1.4, 1.15), 26)


def shelf(chance: random.Random) -> None:
    """Metal, glass and plastic on boards, under small lamps; the camera moves, some objects turn."""
    sky((0.6, 0.7, 1.0), 0.05)
    box((6, 0.1, 4), (0, 0.5, 1.5), textured("Noise", upright=True, Scale=6.0))
    wood = brick((0.35, 0.2, 0.1), (0.5, 0.3, 0.16), upright=False, scale=4.0)
    for z in (0.0, 0.8, 1.6, 2.4):
        box((4, 0.6, 0.05), (0, 0.15, z), wood)
    materials = (
        lambda: paint((0.95, 0.8, 0.5), Metallic=1.0, Roughness=chance.uniform(0.08, 0.3)),
        lambda: glass(any_color(chance)),
        lambda: paint(any_color(chance), Roughness=0.25),
        lambda: checker(any_color(chance), any_color(chance), 12.0),
    )
    kinds: tuple[tuple[str, dict[str, Any]], ...] = (
        ("uv_sphere", {"radius": 0.2, "segments": 48, "ring_count": 24}),
        ("cylinder", {"radius": 0.14, "depth": 0.4, "vertices": 48}),
        ("torus", {"major_radius": 0.14, "minor_radius": 0.06, "rotation": (pi / 2, 0, 0)}),
        ("monkey", {"size": 0.42}),
        ("cube", {"size": 0.3, "rotation": (0, 0, 0.5)}),
    )
    for row, z in enumerate((0.23, 1.03, 1.83)):
        for column in range(7):
            kind, options = kinds[(3 * row + 2 * column + chance.randrange(2)) % len(kinds)]
            place = (0.52 * (column - 3) + chance.uniform(-0.05, 0.05), chance.uniform(-0.05, 0.15), z)
            item = shape(kind, place, materials[(row + column) % len(materials)](), **options)
            if chance.random() < 0.3:
                spin(item, 2.0)
    for place in ((-1.2, -1.0, 2.6), (0.9, -1.2, 2.2), (-0.2, -0.9, 0.9), (1.6, -0.6, 1.3)):
        warm = (1.0, chance.uniform(0.7, 0.9), chance.uniform(0.5, 0.9))
        light("POINT", place, chance.uniform(12, 25), shadow_soft_size=0.04, color=warm)
    camera((-0.5, -3.6, 1.3), (0.2, -3.5, 1.35), (0, 0.2, 1.15), 34)


def lamps(chance: random.Random) -> None:
    """Lamps that move between glass columns, a slab that moves, a wall of brick; the camera moves slowly."""
    sky((0.3, 0.4, 0.7), 0.03)
    box((14, 14, 0.1), (0, 0, -0.05), checker((0.5, 0.45, 0.4), (0.2, 0.2, 0.24), 1.6))
    box((14, 0.2, 5), (0, 4.0, 2.5), brick((0.5, 0.3, 0.2), (0.4, 0.25, 0.2), scale=1.6))
    for index in range(5):
        place = (1.1 * (index - 2) + chance.uniform(-0.15, 0.15), chance.uniform(0.6, 1.8), 0.8)
        shape("cylinder", place, glass((0.625, 0.875, 0.75)), radius=0.2, depth=1.6, vertices=48)
    for _ in range(4):
        place = (chance.uniform(-2, 2), chance.uniform(-0.8, 0.4), 0.25)
        shape("uv_sphere", place, glass(), radius=0.25, segments=48, ring_count=24)
    for _ in range(8):
        size = chance.uniform(0.25, 0.6)
        place = (chance.uniform(-3, 3), chance.uniform(2.2, 3.6), size / 2)
        box((size, size, size), place, paint(any_color(chance)), rotation=(0, 0, chance.random()))
    for index in range(3):
        color = [1.0, 0.8, 0.6]
        chance.shuffle(color)
        lamp = light("POINT", (0, 0, 0), 70.0, shadow_soft_size=0.07, color=color)
        phase, height = 2.0 * pi * index / 3 + chance.random(), chance.uniform(0.8, 1.8)
        animate(lamp, "location", circle(phase, height))
    slab = box((1.0, 0.25, 1.3), (0, 0, 0), paint(any_color(chance), Roughness=0.3))
    animate(slab, "location", lambda t: (-2.2 + 2.4 * t, 2.3, 0.65))
    camera((0.3, -4.4, 1.7), (0.0, -4.3, 1.7), (0, 1.5, 0.9), 35)


SCENES = {
    "courtyard": Scene(courtyard, (0.3, 0.74, 0.25, 0.7)),
    "room": Scene(room, (0.28, 0.6, 0.2, 0.82)),
    "shelf": Scene(shelf, (0.3, 0.74, 0.3, 0.75)),
    "lamps": Scene(lamps, (0.2, 0.64, 0.25, 0.7)),
}


def prepare(build: Callable[[random.Random], None], seed: str, size: tuple[int, int], threads: int) -> Any:
    """Build a scene in an empty file, with Cycles' settings and passes; return it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    build(random.Random(seed))  # noqa: S311  # a layout, not a secret
    render, cycles, layer = scene.render, scene.cycles, scene.view_layers[0]
    render.engine = "CYCLES"
    cycles.device, cycles.use_animated_seed = "CPU", True
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.max_bounces, cycles.diffuse_bounces = 8, 3
    layer.use_pass_z = layer.use_pass_vector = layer.use_pass_normal = True
    layer.cycles.denoising_store_passes = True
    render.resolution_x, render.resolution_y = size
    render.resolution_percentage = 100
    render.use_compositing = render.use_sequencer = False
    image = render.image_settings
    if hasattr(image, "media_type"):  # Blender 5
        image.media_type = "MULTI_LAYER_IMAGE"
    image.file_format, image.color_depth, image.exr_codec = "OPEN_EXR_MULTILAYER", "16", "ZIP"
    if threads:
        render.threads_mode, render.threads = "FIXED", threads
    return scene


def render_frame(scene: Any, number: int, path: Path) -> None:
    """Render a frame, unless its file exists, and append its CPU time to the folder's costs.jsonl."""
    if path.exists():
        return
    partial = path.with_name(f".{path.name}")
    scene.frame_set(number)
    scene.render.filepath = str(partial)
    before = time.process_time()
    bpy.ops.render.render(write_still=True)
    cost = {"frame": number, "cpu": round(time.process_time() - before, 3)}
    with (path.parent / "costs.jsonl").open("a", encoding="utf-8") as costs:
        costs.write(json.dumps(cost) + "\n")
    partial.rename(path)
    sys.stdout.write(f"{path} {cost['cpu']} s\n")
    sys.stdout.flush()


def main(words: Sequence[str]) -> None:
    """Render the scenes of the command line."""
    parser = ArgumentParser("denoise_scenes.py", description="Renders scenes for `bench denoise`.")
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help=f"of {', '.join(SCENES)}; all")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--samples", type=int, nargs="*", default=SAMPLES, help="samples per pixel")
    parser.add_argument(
        "--reference-samples", type=int, default=REFERENCE_SAMPLES, help=f"a multiple of {PART}"
    )
    parser.add_argument("--frames", type=int, nargs=2, default=(1, FRAMES), metavar=("FIRST", "LAST"))
    parser.add_argument("--size", type=int, nargs=2, default=SIZE, metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--variant", type=int, default=0, help="other objects, places and colours")
    parser.add_argument("--threads", type=int, default=0, help="0: one per core")
    options = parser.parse_args(words)
    for name in options.scenes or SCENES:
        build, region = SCENES[name]
        scene = prepare(build, f"{name} {options.variant}", options.size, options.threads)
        for samples in options.samples:
            scene.cycles.samples = samples
            for number in range(options.frames[0], options.frames[1] + 1):
                render_frame(scene, number, options.output / f"{name}-{samples}/{number:04d}.exr")
        render = scene.render
        render.use_border, render.use_crop_to_border = True, False
        render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = region
        scene.cycles.samples = PART
        for part in range(options.reference_samples // PART):
            scene.cycles.seed = REFERENCE_SEED * (part + 1)
            for number in REFERENCES:
                render_frame(scene, number, options.output / f"{name}-reference{part + 1}/{number:04d}.exr")


if __name__ == "__main__":
    main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])
