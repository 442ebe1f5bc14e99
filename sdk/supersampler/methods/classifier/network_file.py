"""Read network.npz of a model folder. The file is not trusted: each array must have the layout of kernels.

The shapes follow from the widths in model.json; `supersampler_export.quantize` explains them.
"""

import io
import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from supersampler.errors import ModelError
from supersampler.methods.array_spec import LARGEST, ArraySpec, checked_arrays
from supersampler.methods.classifier.spec import CLASSES
from supersampler.methods.model_info import ModelInfo

INPUT_PLANES = 16
"""Network inputs of a pixel, one byte each."""
RECORD_WORDS = 18
"""Words of a packed pixel (2x2 display pixels): INPUT_PLANES, then two for inputs at half display size."""
KEPT = (16, 8, 4, 4)
"""Bytes that each level contributes to a pixel of the decoder's input."""
BLOCK, WORD, LANES = 32, 4, 16
"""Outputs that a kernel computes at once; bytes that it multiplies at once; channels of a column."""
FEATURES, HIDDEN = 32, 64
"""Largest numbers of outputs of the decoder and of the hidden layer that kernels support."""
_HEAD = 1 << 14  # maximum bytes of an array's header


def read_network(info: ModelInfo, outputs: int) -> dict[str, NDArray[Any]]:
    """Return the arrays of a model's network.npz, in the layout of kernels.

    Args:
        info: the model.
        outputs: outputs of the last layer.

    Raises:
        ModelError: the file is damaged or too large, kernels do not support the widths in model.json, or an
            array has another type, shape or range than they imply.
    """
    path, specs = info.folder / "network.npz", network_specs(info, outputs)
    try:
        arrays = _arrays_of(path, specs)
    except ModelError:
        raise
    except Exception as error:  # zipfile, zlib and numpy raise whatever damage leads them to
        raise ModelError(f"{path}: is damaged ({type(error).__name__}: {error}). Export it again.") from error
    checked = checked_arrays(arrays, specs, lambda got, want: _refused(path, got, want))
    hidden = checked["hidden.weights"]  # kernels always read FEATURES outputs of the decoder
    more = INPUT_PLANES + FEATURES // WORD - hidden.shape[1]
    checked["hidden.weights"] = np.pad(hidden, ((0, 0), (0, more), (0, 0), (0, 0)))
    return checked


def network_specs(info: ModelInfo, outputs: int) -> dict[str, ArraySpec]:
    """Return the specs of the arrays of a network with the widths in model.json.

    Raises:
        ModelError: kernels do not support the widths.
    """
    network = info.config.get("network")
    problem = width_problem(network if isinstance(network, Mapping) else {})
    if problem is not None:
        raise info.config_error(*problem)
    levels, decoder, hidden = (info.config["network"][name] for name in ("levels", "decoder", "hidden"))
    specs: dict[str, ArraySpec] = {}
    words = RECORD_WORDS
    for level, (channels, room) in enumerate(zip(levels, KEPT, strict=True)):
        kept = channels if level + 1 == len(KEPT) else channels // 2
        made = room * 4**level + channels - kept
        specs |= _layer(f"{level}.first", (_blocks(channels), words, BLOCK, WORD), _blocks(channels) * BLOCK)
        specs |= _layer(f"{level}.spatial", (channels // LANES, 3, LANES, WORD), channels)
        shape = _blocks(made), channels // WORD, BLOCK, WORD
        specs |= _layer(f"{level}.last", shape, _blocks(made) * BLOCK)
        words = (channels - kept) // WORD
    specs |= _layer("decoder", (1, sum(KEPT) // WORD, BLOCK, WORD), BLOCK)
    blocks, words = _blocks(hidden + CLASSES), INPUT_PLANES + -(-decoder // WORD)
    specs |= _layer("hidden", (blocks, words, BLOCK, WORD), blocks * BLOCK)
    specs |= _layer("blend", (outputs, -(-hidden // WORD), WORD), outputs)
    specs["logits.first"] = ArraySpec("int64", (1,), (hidden, hidden))
    specs["logits.scale"] = ArraySpec("float64", (1,), (0.0, LARGEST))
    return specs


def _layer(name: str, weights: tuple[int, ...], outputs: int) -> dict[str, ArraySpec]:
    finite = -LARGEST, LARGEST
    return {
        f"{name}.weights": ArraySpec("int8", weights),
        f"{name}.scale": ArraySpec("float32", (outputs,), finite),
        f"{name}.bias": ArraySpec("float32", (outputs,), finite),
    }


def _blocks(outputs: int) -> int:
    return -(-outputs // BLOCK)


def width_problem(widths: Mapping[str, Any]) -> tuple[str, Any, str] | None:
    """Return name, value and allowed values of a width of `NetworkConfig` that kernels do not support."""
    levels, decoder, hidden = (widths.get(name) for name in ("levels", "decoder", "hidden"))
    max_widths = [room * 4**level * (1 if level + 1 == len(KEPT) else 2) for level, room in enumerate(KEPT)]
    if (
        not isinstance(levels, (list, tuple))
        or len(levels) != len(KEPT)
        or not all(
            type(n) is int and n in range(LANES, m + 1, LANES)
            for n, m in zip(levels, max_widths, strict=True)
        )
    ):
        want = f"{len(KEPT)} multiples of {LANES} up to {', '.join(map(str, max_widths))}"
        return "network.levels", levels, want
    if type(decoder) is not int or not 1 <= decoder <= FEATURES or widths.get("decoder_layers") != 1:
        return "network.decoder", decoder, f"a number from 1 to {FEATURES}, of one layer"
    if type(hidden) is not int or not 1 <= hidden <= HIDDEN - CLASSES:
        return "network.hidden", hidden, f"a number from 1 to {HIDDEN - CLASSES}"
    return None


def _arrays_of(path: Path, specs: Mapping[str, ArraySpec]) -> dict[str, NDArray[Any]]:
    """Read arrays by name, without decompressing more bytes than the expected arrays have."""
    max_bytes = {n: math.prod((np.dtype(s.dtype).itemsize, *map(int, s.shape))) for n, s in specs.items()}
    limit = sum(max_bytes.values()) + len(max_bytes) * _HEAD
    if path.stat().st_size > limit:
        raise _refused(path, f"of {path.stat().st_size} bytes", f"at most {limit}")
    arrays = {}
    with zipfile.ZipFile(path) as file:
        for entry in file.infolist():
            name = entry.filename.removesuffix(".npy")
            if name not in max_bytes or name in arrays:
                raise _refused(path, f"with {name[:80]!r}", f"each of {', '.join(specs)} once")
            if entry.file_size > max_bytes[name] + _HEAD:
                raise _refused(path, f"with {name!r} of {entry.file_size} bytes", f"{specs[name]}")
            with file.open(entry) as data:  # reads at most the declared size
                arrays[name] = _array_of(io.BytesIO(data.read()), max_bytes[name])
    return arrays


def _array_of(data: BinaryIO, max_bytes: int) -> NDArray[Any]:
    if npy.read_magic(data) != (1, 0):
        raise ValueError("not of version 1.0 of numpy's format")
    shape, fortran, dtype = npy.read_array_header_1_0(data)
    values = data.read()
    if fortran or dtype.hasobject or len(values) > max_bytes:
        raise ValueError(f"an array of {dtype} in {len(values)} bytes")
    return np.frombuffer(values, dtype).reshape(shape)


def _refused(path: Path, got: str, want: str) -> ModelError:
    return ModelError(f"{path}: is {got}; want {want}. Export it again.")
