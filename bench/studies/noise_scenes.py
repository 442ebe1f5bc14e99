"""Scenes of Mitsuba 3 with large and small lights, for `noise_model.py`."""

from typing import Any

import mitsuba as mi

SIZE = 96


def scenes() -> list[Any]:
    """Return Mitsuba's descriptions: Cornell box, rooms with a small and with a large lamp, sun and sky."""
    box = mi.cornell_box()
    box["sensor"]["film"] = _film()
    return [box, _room(0.05, 0.1), _room(0.4, 0.3), _outdoors()]


def _film() -> dict[str, Any]:
    return {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}}


def _diffuse(*color: float) -> dict[str, Any]:
    return {"type": "twosided", "of": {"type": "diffuse", "reflectance": {"type": "rgb", "value": color}}}


def _objects(roughness: float) -> dict[str, Any]:
    to = mi.ScalarTransform4f
    camera = to().look_at([0.0, 1.2, 3.6], [0.0, 0.9, 0.0], [0.0, 1.0, 0.0])
    cube = to().translate([0.7, 0.5, -0.2]).rotate([0.0, 1.0, 0.0], 30.0).scale([0.3, 0.5, 0.3])
    floor = to().rotate([1.0, 0.0, 0.0], -90.0).scale(3.0)
    metal = {"type": "roughconductor", "alpha": roughness}
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 6},
        "sensor": {"type": "perspective", "fov": 50, "to_world": camera, "film": _film()},
        "floor": {"type": "rectangle", "to_world": floor, "bsdf": _diffuse(0.5, 0.45, 0.4)},
        "ball": {"type": "sphere", "center": [-0.6, 0.5, 0.0], "radius": 0.5, "bsdf": metal},
        "cube": {"type": "cube", "to_world": cube, "bsdf": _diffuse(0.2, 0.5, 0.7)},
    }


def _lamp(center: list[float], radius: float, radiance: float) -> dict[str, Any]:
    light = {"type": "area", "radiance": {"type": "rgb", "value": [radiance] * 3}}
    return {"type": "sphere", "center": center, "radius": radius, "emitter": light}


def _room(lamp: float, roughness: float) -> dict[str, Any]:
    to, wall = mi.ScalarTransform4f, _diffuse(0.7, 0.6, 0.5)
    walls = {
        "back": to().translate([0.0, 1.0, -1.5]).scale(3.0),
        "left": to().translate([-2.0, 1.0, 0.0]).rotate([0.0, 1.0, 0.0], 90.0).scale(3.0),
        "right": to().translate([2.0, 1.0, 0.0]).rotate([0.0, 1.0, 0.0], -90.0).scale(3.0),
        "ceiling": to().translate([0.0, 2.6, 0.0]).rotate([1.0, 0.0, 0.0], 90.0).scale(4.0),
    }
    planes = {name: {"type": "rectangle", "to_world": at, "bsdf": wall} for name, at in walls.items()}
    return _objects(roughness) | planes | {"lamp": _lamp([1.2, 2.2, 0.3], lamp, 1.5 / lamp**2)}


def _outdoors() -> dict[str, Any]:
    sky = {"type": "constant", "radiance": {"type": "rgb", "value": [0.6, 0.7, 1.0]}}
    return _objects(0.1) | {"sky": sky, "sun": _lamp([6.0, 8.0, 4.0], 0.4, 560.0)}
