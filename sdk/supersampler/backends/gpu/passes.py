"""Compiled passes, and the pipelines and bind groups that are kept for them."""

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import TYPE_CHECKING, Any

from supersampler.backends.gpu.frame import is_texture
from supersampler.backends.gpu.shader import Shader

if TYPE_CHECKING:
    import wgpu

Resource = Any
"""A buffer, a texture view, or a texture of the caller, of which the first mip level is bound."""
MAX_GROUPS = 4
"""Bind groups that are kept of a pass and a pair of histories, for textures that the caller takes in turn."""
BindGroups = dict[Any, OrderedDict[tuple[int, ...], tuple[list[Resource], Any]]]
"""Bind groups of passes, the most recently used ones. They keep their resources alive."""
_PIPELINES = "_supersampler_pipelines"
"""Attribute of a device that holds the pipelines of all models, by code. In a dictionary of this module,
pipelines would keep their device alive."""


class Pass:
    """A compiled shader.

    Args:
        device: the device.
        shader: the shader.
        tile: (x, y) pixels of a workgroup.
        names: resource of each variable that has another name than its resource.
    """

    def __init__(
        self, device: "wgpu.GPUDevice", shader: Shader, tile: tuple[int, int], names: Mapping[str, str]
    ) -> None:
        self.shader, self.tile = shader, tile
        self._device, self._names = device, names
        self._pipeline, self._layouts = _pipeline(device, shader)
        self._bindings = [list(group) for _, group in groupby(shader.bindings, key=lambda b: b.group)]

    def encode(
        self,
        encoder: "wgpu.GPUComputePassEncoder",
        resources: Mapping[str, Resource],
        size: Sequence[int],
        groups: BindGroups,
    ) -> None:
        """Dispatch workgroups that cover `size`, (width, height), on these resources by name.

        Bind groups are taken from `groups`, or made and kept there.
        """
        encoder.set_pipeline(self._pipeline)
        for number, bindings in enumerate(self._bindings):
            bound = [resources[self._names.get(b.name, b.name)] for b in bindings]
            kept = groups.setdefault((self, number), OrderedDict())
            encoder.set_bind_group(number, self._bind_group(number, bindings, bound, kept))
        across, down = (-(-extent // side) for extent, side in zip(size, self.tile, strict=True))
        encoder.dispatch_workgroups(across, down)

    def _bind_group(
        self,
        number: int,
        bindings: Sequence[Any],
        bound: list[Resource],
        kept: OrderedDict[tuple[int, ...], tuple[list[Resource], Any]],
    ) -> Any:
        key = tuple(map(id, bound))
        if key in kept:
            kept.move_to_end(key)
            return kept[key][1]
        entries = []
        for binding, resource in zip(bindings, bound, strict=True):
            target = resource if binding.is_texture else {"buffer": resource}
            if is_texture(resource):
                target = resource.create_view(mip_level_count=1)
            entries.append({"binding": binding.index, "resource": target})
        group = self._device.create_bind_group(layout=self._layouts[number], entries=entries)
        kept[key] = bound, group  # `bound` keeps the ids from being used again
        if len(kept) > MAX_GROUPS:
            kept.popitem(last=False)
        return group


def _pipeline(device: "wgpu.GPUDevice", shader: Shader) -> tuple[Any, list[Any]]:
    known: dict[str, tuple[Any, list[Any]]] = vars(device).setdefault(_PIPELINES, {})
    if shader.code not in known:  # threads compile at the same time, at worst the same shader twice
        layouts = [
            device.create_bind_group_layout(entries=[b.layout() for b in group])
            for _, group in groupby(shader.bindings, key=lambda b: b.group)
        ]
        module = device.create_shader_module(label=shader.name, code=shader.code)
        pipeline = device.create_compute_pipeline(
            label=shader.name,
            layout=device.create_pipeline_layout(bind_group_layouts=layouts),
            compute={"module": module, "entry_point": "main"},
        )
        known.setdefault(shader.code, (pipeline, layouts))
    return known[shader.code]
