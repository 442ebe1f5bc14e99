"""Methods by what the registry says that they have."""

from supersampler.methods.executors import with_shaders
from supersampler.methods.gbuffers import GBUFFERS
from supersampler.methods.registry import methods

WITHOUT_GBUFFERS = [
    name
    for name, spec in methods().items()
    if spec.ships and not spec.extrapolates and GBUFFERS.keys().isdisjoint(spec.inputs)
]
"""Methods that upscale frames without G-buffers."""
WITH_KERNELS = [name for name in WITHOUT_GBUFFERS if methods()[name].cpu and methods()[name].history]
"""Temporal ones of these, on the CPU backend."""
WITH_SHADERS = with_shaders(gbuffers=False)
"""Methods without G-buffers on the GPU backend."""
