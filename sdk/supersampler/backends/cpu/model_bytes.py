"""A model as bytes for the CPU library: method, constants and weights, as in sdk/native/src/arrays.h."""

import struct
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.methods.classifier.network_file import read_network
from supersampler.methods.classifier.spec import Variant
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.spec import MethodSpec, constants_of, flags_of

_MAGIC = b"ssarray1"
_TYPES = {"float32": 0, "int8": 1, "uint8": 2}


def model_bytes(info: ModelInfo, spec: MethodSpec) -> bytes:
    """Return a model as bytes; the library has its method.

    Raises:
        ModelError: network.npz is damaged, or does not match the model's config.
    """
    numbers = [*constants_of(spec), *flags_of(spec), *(("strides",) if spec.extrapolates else ())]
    arrays: dict[str, NDArray[Any]] = {"method": np.frombuffer(spec.cpu.encode() + b"\0", np.uint8)}
    arrays |= {name: np.atleast_1d(np.float32(info.config[name])) for name in numbers}
    if spec.kernel_files:
        arrays |= read_network(info, Variant.of(info.config).outputs)
    return arrays_bytes(arrays)


def arrays_bytes(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Return named arrays as bytes; types other than float32, int8 and uint8 are converted to float32."""
    parts = [_MAGIC]
    for name, given in arrays.items():
        array = np.ascontiguousarray(given if str(given.dtype) in _TYPES else given.astype(np.float32))
        shape = (*array.shape, 1, 1, 1)[:4]
        parts.append(struct.pack("<48s8I", name.encode(), _TYPES[str(array.dtype)], array.ndim, *shape, 0, 0))
        parts.append(array.tobytes() + bytes(-array.nbytes % 8))
    body = b"".join(parts)
    return body + struct.pack("<Q", zlib.crc32(body))
