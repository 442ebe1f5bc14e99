"""Build a scene in Blender and save it: python blender_scenes.py courtyard FILE.blend 640x360.

Three scenes of 24 frames for Cycles, with a camera and objects that move. `courtyard`: sun and sky, thin
bars, patterns; hardly any noise. `room`: light of a window and a lamp from wall to wall; much noise. `shelf`:
metal and glass under small lamps; reflections, which move otherwise than their surfaces.
"""

import math
import random
import sys
from collections.abc import Callable, Sequence
from typing import Any

import bpy

FIRST, LAST = 1, 24
Vector = Sequence[float]


def build(name: str, path: str, size: tuple[int, int]) -> None:
    """Build the scene of that name, and save it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.max_bounces = "CYCLES", 6
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    scene.frame_start, scene.frame_end = FIRST, LAST
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.world = bpy.data.worlds.new("World")
    scene.world.use_nodes = True
    SCENES[name](random.Random(7))  # noqa: S311  # no secret
    bpy.ops.wm.save_as_mainfile(filepath=path)


def courtyard(chance: random.Random) -> None:
    """Build a yard with a fence, brick walls, boxes that slide and a wheel of thin spokes."""
    sky((0.35, 0.5, 0.8), 0.8)
    lamp("SUN", (0, 0, 10), 4.0, rotation=(0.75, 0.15, 0.5), size=0.01)
    plane(40, (0, 0, 0), pattern("ShaderNodeTexChecker", (0.55, 0.5, 0.42), (0.3, 0.29, 0.27), 60))
    bricks = pattern("ShaderNodeTexChecker", (0.5, 0.2, 0.13), (0.42, 0.3, 0.2), 40)
    box((0, 6, 1.5), (14, 0.4, 3), bricks)
    box((-5.5, 0, 1.5), (0.4, 12, 3), bricks)
    iron = paint((0.05, 0.06, 0.07))
    for index in range(36):
        box((-3.6 + 0.2 * index, 2.2, 0.6), (0.03, 0.03, 1.2), iron)
    for height in (0.25, 1.1):
        box((0, 2.2, height), (7.4, 0.03, 0.05), iron)
    for _ in range(14):
        side, place = chance.uniform(0.3, 0.8), (chance.uniform(-4.5, 5), chance.uniform(2.6, 5.4))
        box((*place, side / 2), (side, side, side), paint(color(chance)))
    cart = box(
        (-3, 1, 0.4), (0.9, 0.6, 0.8), pattern("ShaderNodeTexChecker", (0.8, 0.7, 0.1), (0.1, 0.1, 0.1), 6)
    )
    move(cart, "location", (-3, 1, 0.4), (2, 0.7, 0.4))
    hub = ball((1.6, 3.2, 1.4), 0.12, iron)
    for index in range(10):
        spoke = box((0, 0, 0.6), (0.03, 0.03, 1.2), iron)
        spoke.parent, angle = hub, index * math.tau / 10
        spoke.location, spoke.rotation_euler = (
            (0.6 * math.sin(angle), 0, 0.6 * math.cos(angle)),
            (0, angle, 0),
        )
    move(hub, "rotation_euler", (0, 0, 0), (0, 1.2, 0))
    camera(((2.6, -5.2, 1.7), (1.46, 0, 0.3)), ((1.2, -4.6, 1.9), (1.44, 0, 0.16)), 30)


def room(chance: random.Random) -> None:
    """Build a closed room with a window, a lamp, furniture, a ball that rolls and a fan that turns."""
    sky((0.6, 0.75, 1.0), 2.0)
    wall = paint((0.75, 0.73, 0.68))
    plane(8, (0, 0, 0), pattern("ShaderNodeTexBrick", (0.4, 0.22, 0.1), (0.3, 0.16, 0.08), 16))
    box((0, 0, 3.05), (8, 8, 0.1), wall)
    box((0, 4, 1.5), (8, 0.1, 3), pattern("ShaderNodeTexChecker", (0.7, 0.68, 0.6), (0.6, 0.62, 0.66), 24))
    box((0, -4, 1.5), (8, 0.1, 3), wall)
    box((4, 0, 1.5), (0.1, 8, 3), wall)
    parts: list[tuple[Vector, Vector]] = [  # around the window
        ((-4, -2.5, 1.5), (0.1, 3, 3)),
        ((-4, 3, 1.5), (0.1, 2, 3)),
        ((-4, 0.5, 0.4), (0.1, 3, 0.8)),
        ((-4, 0.5, 2.8), (0.1, 3, 0.5)),
        ((-4, 0.5, 1.6), (0.08, 0.06, 1.8)),
    ]
    for place, size in parts:
        box(place, size, wall)
    lamp("AREA", (-3.9, 0.5, 1.7), 160, rotation=(0, -math.pi / 2, 0), size=1.8)
    lamp("POINT", (2.4, 2.6, 1.7), 60, color=(1.0, 0.7, 0.4), size=0.1)
    wood = paint((0.35, 0.2, 0.1))
    box((0.6, 1.6, 0.75), (2.2, 1.0, 0.06), wood)
    for x in (-0.4, 1.6):
        for y in (1.2, 2.0):
            box((x, y, 0.37), (0.06, 0.06, 0.74), wood)
    for index in range(5):
        box((3.4, 0.6 + 0.6 * index, 1.2), (0.9, 0.03, 2.4), wood)
    for height in (0.5, 1.0, 1.5, 2.0):
        box((3.4, 1.8, height), (0.9, 2.4, 0.03), wood)
        for _ in range(12):
            tall = chance.uniform(0.2, 0.38)
            place = (chance.uniform(3.05, 3.3), chance.uniform(0.7, 2.9), height + tall / 2)
            box(place, (0.3, chance.uniform(0.04, 0.09), tall), paint(color(chance)))
    for _ in range(6):
        radius = chance.uniform(0.07, 0.16)
        ball(
            (chance.uniform(-0.3, 1.5), chance.uniform(1.3, 1.9), 0.78 + radius), radius, paint(color(chance))
        )
    rolling = ball((-2, 0.6, 0.3), 0.3, pattern("ShaderNodeTexChecker", (0.8, 0.1, 0.1), (0.9, 0.9, 0.85), 8))
    move(rolling, "location", (-2.2, 0.6, 0.3), (0.2, 0.3, 0.3))
    move(rolling, "rotation_euler", (0, 0, 0), (0, 8, 0))
    hub = ball((-0.6, 2.2, 2.6), 0.1, wood)
    for index in range(4):
        blade = box((0, 0, 0), (1.6, 0.16, 0.02), wood)
        blade.parent, angle = hub, index * math.tau / 4
        blade.location, blade.rotation_euler = (
            (0.8 * math.cos(angle), 0.8 * math.sin(angle), 0),
            (0.3, 0, angle),
        )
    move(hub, "rotation_euler", (0, 0, 0), (0, 0, 2.4))
    camera(((-1.8, -3.2, 1.5), (1.45, 0, -0.42)), ((-1.2, -2.9, 1.6), (1.43, 0, -0.3)), 22)


def shelf(chance: random.Random) -> None:
    """Build metal, glass and plastic on a table under small lamps; a ring turns, a ball slides."""
    sky((0.02, 0.025, 0.035), 1.0)
    plane(
        14,
        (0, 0, 0),
        pattern("ShaderNodeTexChecker", (0.5, 0.5, 0.52), (0.16, 0.16, 0.2), 40, roughness=0.25),
    )
    for _ in range(5):
        place = (chance.uniform(-3, 3), chance.uniform(-1, 3), chance.uniform(2.4, 3.2))
        lamp("POINT", place, 60, color=(1.0, chance.uniform(0.6, 1), chance.uniform(0.4, 1)), size=0.12)
    lamp("AREA", (0, -2, 4), 120, size=2.0)
    box((0, 4, 1.5), (10, 0.2, 3), pattern("ShaderNodeTexChecker", (0.2, 0.3, 0.4), (0.3, 0.25, 0.2), 30))
    kinds: list[dict[str, float]] = [
        {"metallic": 1.0, "roughness": 0.05},
        {"metallic": 1.0, "roughness": 0.35},
        {"roughness": 0.1},
        {"transmission": 1.0, "roughness": 0.0},
    ]
    for index in range(28):
        radius, kind = chance.uniform(0.16, 0.38), kinds[index % len(kinds)]
        ball(
            (chance.uniform(-2.6, 2.6), chance.uniform(-0.6, 3.4), radius),
            radius,
            paint(color(chance), **kind),
        )
    bpy.ops.mesh.primitive_torus_add(major_radius=0.6, minor_radius=0.05, location=(0.2, 0.2, 0.7))
    ring = bpy.context.object
    ring.data.materials.append(paint((0.9, 0.7, 0.3), metallic=1.0, roughness=0.15))
    move(ring, "rotation_euler", (1.4, 0, 0), (1.4, 0, 2.0))
    sliding = ball((-1.6, -0.9, 0.3), 0.3, paint((0.9, 0.9, 0.9), metallic=1.0, roughness=0.02))
    move(sliding, "location", (-1.6, -0.9, 0.3), (0.8, -1.1, 0.3))
    camera(((-1.4, -4.6, 1.9), (1.28, 0, -0.28)), ((-0.5, -4.7, 1.8), (1.29, 0, -0.1)), 32)


SCENES: dict[str, Callable[[random.Random], None]] = {"courtyard": courtyard, "room": room, "shelf": shelf}


def color(chance: random.Random) -> Vector:
    """Return a random colour, linear RGB."""
    return [chance.uniform(0.08, 0.8) for _ in range(3)]


def sky(light: Vector, strength: float) -> None:
    """Set the light of the world."""
    background = bpy.context.scene.world.node_tree.nodes["Background"].inputs
    background["Color"].default_value, background["Strength"].default_value = (*light, 1.0), strength


def paint(base: Vector, *, metallic: float = 0.0, roughness: float = 0.6, transmission: float = 0.0) -> Any:
    """Return a material of one colour."""
    material = bpy.data.materials.new("Paint")
    material.use_nodes = True
    inputs = material.node_tree.nodes["Principled BSDF"].inputs
    inputs["Base Color"].default_value = (*base, 1.0)
    inputs["Metallic"].default_value, inputs["Roughness"].default_value = metallic, roughness
    inputs["Transmission Weight"].default_value = transmission
    return material


def pattern(kind: str, first: Vector, second: Vector, scale: float, *, roughness: float = 0.7) -> Any:
    """Return a material of two colours in a pattern: a texture node of this kind."""
    material = paint(first, roughness=roughness)
    tree = material.node_tree
    texture, coordinates = tree.nodes.new(kind), tree.nodes.new("ShaderNodeTexCoord")
    texture.inputs["Scale"].default_value = scale
    for index, value in enumerate((first, second)):
        texture.inputs[f"Color{index + 1}"].default_value = (*value, 1.0)
    tree.links.new(coordinates.outputs["Generated"], texture.inputs["Vector"])
    tree.links.new(texture.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    return material


def plane(size: float, place: Vector, material: Any) -> None:
    """Add a level square."""
    bpy.ops.mesh.primitive_plane_add(size=size, location=place)
    bpy.context.object.data.materials.append(material)


def box(place: Vector, size: Vector, material: Any) -> Any:
    """Add a box, its middle at `place`, and return it."""
    bpy.ops.mesh.primitive_cube_add(size=1, location=place, scale=size)
    bpy.context.object.data.materials.append(material)
    return bpy.context.object


def ball(place: Vector, radius: float, material: Any) -> Any:
    """Add a sphere, and return it."""
    bpy.ops.mesh.primitive_uv_sphere_add(radius=radius, location=place, segments=48, ring_count=24)
    bpy.ops.object.shade_smooth()
    bpy.context.object.data.materials.append(material)
    return bpy.context.object


def lamp(
    kind: str,
    place: Vector,
    energy: float,
    *,
    size: float,
    rotation: Vector = (0, 0, 0),
    color: Vector = (1, 1, 1),
) -> None:
    """Add a light: SUN, AREA or POINT."""
    data = bpy.data.lights.new("Lamp", kind)
    data.energy, data.color = energy, color
    setattr(data, {"SUN": "angle", "AREA": "size", "POINT": "shadow_soft_size"}[kind], size)
    item = bpy.data.objects.new("Lamp", data)
    item.location, item.rotation_euler = place, rotation
    bpy.context.scene.collection.objects.link(item)


def camera(start: tuple[Vector, Vector], end: tuple[Vector, Vector], lens: float) -> None:
    """Add the camera, from (place, rotation) to (place, rotation)."""
    data = bpy.data.cameras.new("Camera")
    data.lens = lens
    item = bpy.data.objects.new("Camera", data)
    bpy.context.scene.collection.objects.link(item)
    bpy.context.scene.camera = item
    for index, name in enumerate(("location", "rotation_euler")):
        move(item, name, start[index], end[index])


def move(item: Any, name: str, start: Vector, end: Vector) -> None:
    """Key a property at the first and the last frame, with equal steps between."""
    for frame, value in ((FIRST, start), (LAST, end)):
        setattr(item, name, value)
        item.keyframe_insert(name, frame=frame)
    for curve in item.animation_data.action.fcurves:
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"


if __name__ == "__main__":
    width, height = sys.argv[-1].split("x")
    build(sys.argv[-3], sys.argv[-2], (int(width), int(height)))
