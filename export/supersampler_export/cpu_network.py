"""`network.npz` of a model folder: the int8 network of the CPU backend."""

import io
from dataclasses import replace
from typing import Any

import numpy as np

from supersampler.methods.classifier.spec import CLASSES, ClassifierConfig
from supersampler.methods.spec import constants_of, flags_of
from supersampler_export.calibrate import calibrated
from supersampler_export.quantize import BLOCK, KEPT, quantized
from supersampler_model.methods.base import Method
from supersampler_model.methods.classifier.model import Classifier
from supersampler_model.methods.classifier.network import ClassifierNetwork


def cpu_network(method: Method) -> bytes | None:
    """Return the int8 network; None without kernels for the method's config."""
    if not isinstance(method, Classifier) or type(method.net) is not ClassifierNetwork:
        return None
    # the fields that kernels read or are compiled for; the others must have their defaults
    names = "network", *constants_of(method.spec), *flags_of(method.spec)
    constants = {name: getattr(method.config, name) for name in names}
    if method.config != replace(type(method.config)(), **constants) or not _fits(method.config):
        return None
    stream = io.BytesIO()
    arrays: dict[str, Any] = quantized(method.net, calibrated(method))
    np.savez(stream, **arrays)
    return stream.getvalue()


def _fits(config: ClassifierConfig) -> bool:
    """Whether the kernels support networks of these widths."""
    widths = config.network
    kept = [*(channels // 2 for channels in widths.levels[:-1]), widths.levels[-1]]
    return (
        len(kept) == len(KEPT)
        and all(channels // 4**i <= room for i, (channels, room) in enumerate(zip(kept, KEPT, strict=True)))
        and all(channels % 16 == 0 for channels in widths.levels)
        and widths.decoder <= BLOCK
        and widths.decoder_layers == 1
        and widths.hidden + CLASSES <= 2 * BLOCK
    )
