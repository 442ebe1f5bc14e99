"""The network of `classifier` in ONNX Runtime, between the kernels that gather and compose."""

from collections.abc import Sequence

import numpy as np

from supersampler.backends.cpu.kernel_loader import Call
from supersampler.backends.cpu.layout import INPUT_PLANES
from supersampler.backends.cpu.memory import aligned
from supersampler.backends.cpu.structs import pack
from supersampler.backends.cpu.threads import ThreadPool
from supersampler.backends.cpu.tiles import Tiles
from supersampler.backends.onnx.session import open_session, running, session_options
from supersampler.errors import ModelError
from supersampler.frame import Float32, Size
from supersampler.methods.classifier.int8_network import level_scratch, network_inputs
from supersampler.methods.classifier.spec import CLASSES, DEFAULT_INPUTS
from supersampler.methods.classifier.structs import NetworkOutputs
from supersampler.methods.model_info import ModelInfo, TensorInfo
from supersampler.methods.spec import HALF

COMPLETE = "methods.classifier.kernels.encode.complete_inputs"
SIGNED = slice(4 * DEFAULT_INPUTS.index("depth_difference"), 4 * DEFAULT_INPUTS.index("depth_difference") + 4)
"""Planes of `packed` in [-1, 1]; all other inputs are in [0, 1]."""
_PACKED, _HALF_INPUTS = 4 * INPUT_PLANES, CLASSES + 2
_EXACT_PRODUCTS = "session.x64quantprecision"
"""Option of ONNX Runtime: without it, sums of two products saturate on x86-64 processors without VNNI."""


class NetworkSession:
    """A session of `network.onnx` or `network.int8.onnx`, not yet bound to kernels.

    Args:
        info: the model, whose folder has the file.
        precision: key of the graph in `ModelInfo.networks`.
        providers: execution providers, in order of preference.
        threads: number of CPU threads of the session; 0 uses every core.
        parameters: number of blend parameters of a display pixel.

    Attributes:
        path: the file.
        precision: as given.
        providers: the providers in use.

    Raises:
        ModelError: the graph is damaged, or its tensors are not those of this network.
        ProviderError: ONNX Runtime uses another provider.
    """

    def __init__(
        self, info: ModelInfo, precision: str, providers: Sequence[str], threads: int, parameters: int
    ) -> None:
        self.path, self.precision = info.networks[precision], precision
        options = session_options(threads)
        options.add_session_config_entry(_EXACT_PRODUCTS, "1")
        inputs, outputs = (
            [TensorInfo(name, "float32", (1, channels, *HALF)) for name, channels in tensors.items()]
            for tensors in (
                {"packed": _PACKED, "half_inputs": _HALF_INPUTS},
                {"logits": CLASSES, "blend_parameters": 4 * parameters},
            )
        )
        self._outputs = outputs
        self._session = open_session(self.path, options, providers, inputs=inputs, outputs=outputs)
        self.providers: list[str] = self._session.get_providers()

    def run(self, planes: Float32) -> NetworkOutputs:
        """Infer from the inputs, (channels of both, h, w), one after the other.

        Raises:
            ModelError: the graph fails, or returns tensors of other shapes than it states.
        """
        feeds = {"packed": planes[None, :_PACKED], "half_inputs": planes[None, _PACKED:]}
        with running(self.path):
            results = self._session.run([tensor.name for tensor in self._outputs], feeds)
        for tensor, result in zip(self._outputs, results, strict=True):
            if result.shape != (want := (*tensor.shape[:2], *planes.shape[1:])):
                raise ModelError(f"{self.path}: returned {tensor.name!r} of {result.shape}; want {want}.")
        return NetworkOutputs(*(np.ascontiguousarray(result[0], np.float32) for result in results))


class OnnxNetwork:
    """A session, and the kernel that completes its inputs.

    Args:
        session: the session.
        complete: the kernel COMPLETE.
    """

    def __init__(self, session: NetworkSession, complete: Call) -> None:
        self.session, self.complete = session, complete
        self.precision = session.precision

    def buffers(self, half: Size, pool: ThreadPool) -> "Inference":
        """Allocate the inputs for this number of packed pixels."""
        return Inference(self, half, pool)


class Inference:
    """The network at one size.

    Attributes:
        inputs: its inputs, as bytes.
    """

    def __init__(self, network: OnnxNetwork, half: Size, pool: ThreadPool) -> None:
        self._network, self._pool, (width, height) = network, pool, half
        self.inputs = network_inputs(half)
        self._bytes = self.inputs.records.view(np.uint8)[:, :width].transpose(2, 0, 1)
        self._planes: Float32 = aligned((_PACKED + _HALF_INPUTS, height, width))
        self._factors = np.full((len(self._planes), 1, 1), 1.0 / 255.0, np.float32)
        self._factors[SIGNED] *= 2.0
        unused = aligned((4,), np.uint8)  # of layers
        self._scratch = [level_scratch(self.inputs, unused) for _ in range(pool.threads)]

    def run(self, tiles: Tiles) -> tuple[NetworkOutputs]:  # noqa: ARG002  # a session inputs whole images
        """Infer all pixels, of which those outside of gathered tiles mean nothing; see `compose_rows`."""
        outputs: list[NetworkOutputs] = []
        self._pool.run_rows("network inputs", self.inputs.half_height, self._read)
        self._pool.run_rows(  # by the pool, which inputs the time
            "network", 1, lambda *_: outputs.append(self._network.session.run(self._planes))
        )
        return (outputs[0],)

    def _read(self, y0: int, y1: int, worker: int) -> None:
        """Complete rows of the inputs, and convert them to floats."""
        self._network.complete(pack(self.inputs), pack(self._scratch[worker]), y0, y1)
        np.multiply(self._bytes[:, y0:y1], self._factors, out=self._planes[:, y0:y1])
        self._planes[SIGNED, y0:y1] -= 1.0
