"""The draw calls of one scene: its instances on the GPU, and the surface and shadow passes."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from supersampler_model.data.renderer.assets import Assets
from supersampler_model.data.renderer.programs import BLOCKS
from supersampler_model.data.renderer.uniforms import DRAW_BYTES, PALETTES_BYTES, draw_blocks, palette_blocks
from supersampler_model.data.scenes.scene import Instance, Scene


class Draws:
    """All instances of a scene, in drawing order."""

    def __init__(self, gl: Any, assets: Assets, scene: Scene) -> None:
        self._gl, self._assets = gl, assets
        self._instances = tuple(sorted(scene.instances, key=lambda instance: _order(instance, scene)))
        skinned = [instance for instance in self._instances if instance.mesh.skin is not None]
        self._palette_of = {id(instance): index for index, instance in enumerate(skinned)}
        self._draws: Any = gl.buffer(draw_blocks(self._instances)) if self._instances else None
        self._palettes: Any = gl.buffer(palette_blocks(skinned)) if skinned else None

    def surfaces(self, rigid: Any, skinned: Any) -> None:
        """Draw all, with the program for rigid and for skinned meshes."""
        for instance in self._bound():
            # The projection flips y: counter-clockwise triangles of the world are clockwise on the screen.
            self._gl.front_face = "ccw" if _mirrors(instance) else "cw"
            if instance.material.double_sided:
                self._gl.disable(self._gl.CULL_FACE)
            else:
                self._gl.enable(self._gl.CULL_FACE)
            self._assets.bind_material(instance.material, BLOCKS["Surface"])
            self._assets.draw(instance.mesh, skinned if instance.mesh.skin else rigid)

    def shadows(self, rigid: Any, skinned: Any) -> None:
        """Draw both sides of all that casts a shadow."""
        self._gl.disable(self._gl.CULL_FACE)
        for instance in self._bound():
            if instance.casts_shadow:
                self._assets.bind_material(instance.material, BLOCKS["Surface"], maps=1)
                self._assets.draw(instance.mesh, skinned if instance.mesh.skin else rigid)

    def _bound(self) -> Iterator[Instance]:
        for index, instance in enumerate(self._instances):
            self._draws.bind_to_uniform_block(BLOCKS["Draw"], index * DRAW_BYTES, DRAW_BYTES)
            if instance.mesh.skin is not None:
                offset = self._palette_of[id(instance)] * PALETTES_BYTES
                self._palettes.bind_to_uniform_block(BLOCKS["Palettes"], offset, PALETTES_BYTES)
            yield instance


def _order(instance: Instance, scene: Scene) -> tuple[bool, float]:
    """Sort key: alpha-tested surfaces last, as they delay the depth test; the others front to back."""
    center = instance.model @ np.append(instance.mesh.center(), 1.0)
    distance = float(np.linalg.norm(center[:3] - scene.camera.position))
    return instance.material.alpha_cutoff is not None, distance


def _mirrors(instance: Instance) -> bool:
    return bool(np.linalg.det(instance.model[:3, :3]) < 0.0)
