"""Base classes of methods: pure functions step(frame inputs, history) -> (image, history), as torch modules.

The method's `spec`, in the SDK, gives names, shapes, ratios and constants. `forward` takes the inputs and
then the history tensors of the spec. It returns the image, the next history and the auxiliary outputs, in the
order of the spec. A history of zeros means no history. Methods implement `compute`, on colours without
pre-exposure.
"""

import json
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import is_dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple, Self, get_type_hints

import numpy as np
import torch
from torch import Tensor, nn

from supersampler.errors import ArgumentError, ShotError, shown
from supersampler.io.safetensors import open_safetensors, write_safetensors
from supersampler.methods.model_info import extents
from supersampler.methods.registry import find_method
from supersampler.methods.spec import BETWEEN, CHANNELS, EARLIER, RENDER, SHADED, MethodSpec, Shape, sized
from supersampler_model import ops

MAX_WIDTH = 1024
"""Maximum of whole numbers in the config of a weights file, such as widths of layers, and of their number."""
_MAX_WEIGHTS = 1 << 28
"""Maximum bytes of the tensors of a weights file."""


class Outputs(NamedTuple):
    """The results of one step."""

    image: Tensor
    history: list[Tensor]
    aux_outputs: list[Tensor]


class NetworkSubgraph(NamedTuple):
    """The network of a step, for backends that compute the other stages themselves."""

    module: nn.Module
    inputs: Mapping[str, Shape]
    outputs: Mapping[str, Shape]
    ratio: int = 2  # of display to render size, for shapes of both sizes


class Method(nn.Module):
    """Base of all methods. Stages: `gather` resamples, `network` infers, `finish` blends and sanitizes."""

    spec: ClassVar[MethodSpec]  # names, shapes, ratios and constants of the method; each subclass sets it
    name: ClassVar[str]  # copies of the spec's, as the next two
    history: ClassVar[Mapping[str, Shape]]
    ratios: ClassVar[tuple[float, float]]
    config: Any  # the constants, an instance of `spec.config`
    compute: Callable[..., tuple[Tensor, ...]]  # `forward` without pre-exposure
    provenance: Mapping[str, Any] = MappingProxyType({})  # of the weights; empty without a network

    def __init__(self, config: Any = None) -> None:
        super().__init__()
        self.config = config or self.spec.config()

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "spec" in cls.__dict__:
            cls.name, cls.history, cls.ratios = cls.spec.name, cls.spec.history, cls.spec.ratios

    def forward(self, *arguments: Tensor) -> tuple[Tensor, ...]:
        """Divide the colour by `pre_exposure`, run `compute`, and multiply the image by `pre_exposure`."""
        names = self.inputs()
        if "pre_exposure" not in names:
            return self.compute(*arguments)
        given = dict(zip(names, arguments, strict=False))
        pre_exposure = given.pop("pre_exposure")
        if "color" in given:
            given["color"] = given["color"] / pre_exposure
        image, *others = self.compute(*given.values(), *arguments[len(names) :])
        return image * pre_exposure, *others

    @classmethod
    def inputs(cls) -> list[str]:
        """Return the names of the frame inputs of the step, in order."""
        return list(cls.spec.inputs)

    @classmethod
    def extrapolates(cls) -> bool:
        """Return whether the method extrapolates unshaded frames at render size, and does not upscale."""
        return cls.spec.image[2:] == RENDER

    @classmethod
    def after_shaded(
        cls, frame: Mapping[str, Tensor], history: Sequence[Tensor] | None = None
    ) -> list[Tensor]:
        """Return the history of an extrapolating method after a shaded frame (docs/contract.md).

        Such methods do not step on shaded frames: the history is a copy of the frame, without pre-exposure.
        `frame` has the inputs of the step and `color`, by name. `history` is None after a start or a cut.
        """
        previous = None if history is None else dict(zip(cls.history, history, strict=True))
        next_history: dict[str, Tensor] = {}
        for name in cls.history:
            own = name.removeprefix("earlier_")
            if own != name:
                next_history[name] = next_history[own] if previous is None else previous[own]
            elif name == "motion" or (name == "shaded_motion" and previous is None):
                next_history[name] = torch.zeros_like(frame["motion"])
            elif name == "color":
                next_history[name] = frame["color"] / frame["pre_exposure"]
            else:
                source = {"motion_jitter": "jitter", "shaded_motion": "motion"}.get(name, name)
                next_history[name] = frame[source] if source in frame else frame[f"gbuffer_{source}"]
        return list(next_history.values())

    def step(self, *arguments: Tensor) -> Outputs:
        """Run `forward` and split its results."""
        image, *rest = self(*arguments)
        count = len(self.history)
        return Outputs(image, rest[:count], rest[count:])

    def subgraph(self) -> NetworkSubgraph | None:
        """Return the network; None if there is none, or it cannot run as one graph."""
        return None

    def on_extrapolated(self) -> "Method | None":
        """Return the method for extrapolated frames, on the same history; None: this method."""
        return None

    def first_history(self, display: ops.Size, render: ops.Size, channels: int = 1) -> list[Tensor]:
        """Return zeros: no history."""
        sizes = extents(render=render, display=display, previous=render) | {CHANNELS: channels}
        for pair in (SHADED, EARLIER, BETWEEN):
            sizes |= dict(zip(pair, render[::-1], strict=True))
        return [torch.zeros(sized(shape, sizes)) for shape in self.history.values()]


class Trained(NamedTuple):
    """Weights of one method, the content of a weights file."""

    method: str  # its name
    config: dict[str, Any]  # config of the method, plain data
    facts: dict[str, Any]  # provenance: steps, hash of the data, commit, scores
    tensors: dict[str, Tensor]


class LearnedMethod(Method):
    """Base of methods with weights."""

    net: nn.Module  # the only part with parameters
    runs_in_fp16: ClassVar[bool] = False
    """Whether all stages compute colours in [0, 1] and weights in the type of the network; otherwise only the
    network may use half floats."""

    def __init__(self, config: Any = None) -> None:
        super().__init__(config)
        self.net = self.make_network()

    @property
    def dtype(self) -> torch.dtype:
        """The working type: the type of the network's parameters."""
        return next(self.net.parameters()).dtype

    @abstractmethod
    def make_network(self) -> nn.Module:
        """Return the untrained network, of the widths in `config`."""

    @classmethod
    def of(cls, trained: Trained) -> Self:
        """Return the method with trained weights, in evaluation mode; missing config fields have defaults.

        Raises:
            ArgumentError: the weights are of another method, or of another version of this one.
        """
        if trained.method != cls.name:
            raise ArgumentError("weights", got=f"of {trained.method}", want=f"of {cls.name}")
        try:
            method = cls(config_of(cls.spec.config, trained.config))
            method.load_state_dict(trained.tensors)
        except (TypeError, LookupError, AttributeError, RuntimeError, ValueError) as error:  # other structure
            got = f"of another version ({' '.join(str(error).split())})"
            want = f"of this version of {cls.name}: train it again"
            raise ArgumentError("weights", got=got, want=want) from error
        method.provenance = trained.facts
        return method.eval()


def config_of(kind: type[Any], plain: Mapping[str, Any]) -> Any:
    """Return a config dataclass from plain data: mappings become dataclasses, lists become tuples.

    Raises:
        TypeError: the dataclass has no field of a name.
        ValueError: a whole number is beyond MAX_WIDTH: the network would take all memory.
    """
    hints = get_type_hints(kind)
    values: dict[str, Any] = {}
    for name, value in plain.items():
        if is_dataclass(hints.get(name)):
            values[name] = config_of(hints[name], value)
        else:
            items = value if isinstance(value, list) else [value]
            if len(items) > MAX_WIDTH or any(type(item) is int and abs(item) > MAX_WIDTH for item in items):
                raise ValueError(f"{name} is {shown(value)}; want at most {MAX_WIDTH}")
            values[name] = tuple(value) if isinstance(value, list) else value
    return kind(**values)


def shipped_weights(method: str) -> Path:
    """Return the path of a method's released weights.

    Raises:
        ArgumentError: none ship.
    """
    spec = find_method(method)
    if spec is None or not spec.weights:
        raise ArgumentError("--weights", got=None, want=f"a file, as none ship for {method}")
    return Path(__file__).parents[1] / "weights" / spec.weights


def save_trained(path: Path, trained: Trained) -> None:
    """Write a weights file atomically: safetensors whose header holds method, config and provenance.

    Raises:
        ShotError: the disk refuses.
    """
    header = {name: getattr(trained, name) for name in ("method", "config", "facts")}
    arrays = {name: tensor.numpy() for name, tensor in trained.tensors.items()}
    write_safetensors(path, arrays, {"trained": json.dumps(header, sort_keys=True)})


def load_trained(path: Path) -> Trained:
    """Read a weights file.

    Raises:
        ArgumentError: the file is missing, damaged, or not a weights file.
    """
    try:
        arrays, metadata = open_safetensors(path)
        if (size := sum(array.nbytes for array in arrays.values())) > _MAX_WEIGHTS:
            raise ValueError(f"{size >> 20} MiB of tensors; want at most {_MAX_WEIGHTS >> 20}")
        header: Mapping[str, Any] = json.loads(metadata["trained"])
        if not isinstance(header["facts"], dict):
            raise TypeError(f"facts is {shown(header['facts'])}")
        tensors = {name: torch.from_numpy(np.array(array)) for name, array in arrays.items()}
        return Trained(header["method"], header["config"], header["facts"], tensors)
    except (ShotError, KeyError, TypeError, ValueError, RecursionError) as error:
        problem = error.problem if isinstance(error, ShotError) else error
        want = "a weights.safetensors that `supersampler train` wrote"
        raise ArgumentError("weights", got=f"{path} ({problem})", want=want) from error
