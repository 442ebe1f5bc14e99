"""Variants of `gbuffer` at 4x for `ablation.py`, each without one part (Wang et al. 2025, VI and IX)."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import Any

from supersampler.methods.gbuffer.spec import SMALL_NETWORK, GBufferConfig
from supersampler_model.methods.gbuffer.buffers import FrameInputs, Gathered, History, Surfaces
from supersampler_model.methods.gbuffer.model import SmallGBuffer4
from supersampler_model.methods.gbuffer.surfaces import neutral_surfaces
from supersampler_model.ops.sampling import pick
from supersampler_model.ops.size import render_size_of
from supersampler_model.training.gbuffer_task import GBufferTask, GBufferWeights
from supersampler_model.training.task import Task

ALONE = ("base_color", "normal", "roughness", "metallic", "specular")  # without these, depth is


class Lacking(SmallGBuffer4):
    """One that knows less of surfaces.

    Args:
        unread: fields of `Surfaces` replaced by those of `neutral_surfaces`, at both sizes.
        nearest: fields that are the nearest sample's at display size.
    """

    def __init__(self, unread: Collection[str] = (), nearest: Collection[str] = ()) -> None:
        super().__init__()
        self.unread, self.nearest = unread, nearest

    def gather(self, frame: FrameInputs, history: History) -> Gathered:
        """See `GBuffer.gather`."""
        grid = frame.view.grid(render_size_of(frame.color))
        near = {name: pick(getattr(frame.render, name), grid) for name in self.nearest}
        display = self._known(frame.display._replace(**near))
        return super().gather(frame._replace(render=self._known(frame.render), display=display), history)

    def _known(self, surfaces: Surfaces) -> Surfaces:
        grey = neutral_surfaces(surfaces.depth)
        return surfaces._replace(**{name: getattr(grey, name) for name in self.unread})


def lacking(*unread: str) -> Callable[[], Task[Any]]:
    """Return what makes the task of one without these buffers."""
    return lambda: GBufferTask(Lacking(unread))


def changed(**fields: Any) -> Callable[[], Task[Any]]:
    """Return what makes the task of one with other settings."""
    return lambda: GBufferTask(SmallGBuffer4(GBufferConfig(ratio=4, **{"network": SMALL_NETWORK, **fields})))


def built(**fields: Any) -> Callable[[], Task[Any]]:
    """Return what makes the task of one with other settings of the network."""
    return changed(network=replace(SMALL_NETWORK, **fields))


VARIANTS: Mapping[str, Callable[[], Task[Any]]] = {
    "all of it": changed(),
    "without base colour": lacking("base_color"),
    "without normals": lacking("normal"),
    "without metallic": lacking("metallic"),
    "without roughness": lacking("roughness"),
    "without specular": lacking("specular"),
    "without depth of display size": lambda: GBufferTask(Lacking(nearest=("depth",))),
    "depth alone": lacking(*ALONE),
    "without G-buffers of display size": lambda: GBufferTask(Lacking(nearest=Surfaces._fields)),
    "without the gated encoder, unshuffled alone": built(surfaces=SMALL_NETWORK.surfaces[-1:], gated=False),
    "without the gated branch": built(gated=False),
    "without the enhancer": built(attention="none"),
    "attention one way": built(attention="one"),
    "without the masks of the blender": changed(masked=False),
    "without the refiner": built(refined=False),
    "without weights in the loss": lambda: GBufferTask(
        SmallGBuffer4(), GBufferWeights(reflective=0.0, reflective_structure=0.0)
    ),
    "history not blended, features alone": changed(blended=False),
}
