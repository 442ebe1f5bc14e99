"""`gbuffer-depth`: `gbuffer-small` for forward renderers, with depth as the only G-buffer."""

from collections.abc import Mapping
from typing import ClassVar

from torch import Tensor

from supersampler.methods.gbuffer.spec import GBUFFER_DEPTH
from supersampler_model.methods.base import display_size_of, render_size_of
from supersampler_model.methods.gbuffer.buffers import History, Surfaces
from supersampler_model.methods.gbuffer.model import GBuffer
from supersampler_model.methods.gbuffer.surfaces import matte
from supersampler_model.ops.sampling import View


class DepthGBuffer(GBuffer):
    """`GBuffer` with depth at display size, from a depth prepass, as the only G-buffer."""

    spec: ClassVar = GBUFFER_DEPTH

    def forward(  # type: ignore[override]  # the signature is the contract: fewer inputs
        self,
        color: Tensor,
        depth: Tensor,
        motion: Tensor,
        jitter: Tensor,
        exposure: Tensor,
        display_size: Tensor,
        gbuffer_display_depth: Tensor,
        *history: Tensor,
    ) -> tuple[Tensor, ...]:
        """See `GBuffer.forward`."""
        render, display = self.surfaces_of({"gbuffer_display_depth": gbuffer_display_depth}, depth)
        view = View(display_size_of(display_size), render_size_of(color), jitter)
        return self.step_outputs(color, motion, exposure, render, display, History(*history), view)

    @staticmethod
    def surfaces_of(gbuffer: Mapping[str, Tensor], depth: Tensor) -> tuple[Surfaces, Surfaces]:
        """Return surfaces of which only depth is known."""
        return matte(depth), matte(gbuffer["gbuffer_display_depth"])
