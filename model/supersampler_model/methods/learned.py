"""Base class of methods with a network; they are built from a config and load a weights file."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import is_dataclass
from typing import Any, ClassVar, Self, get_type_hints

import torch
from torch import nn

from supersampler.errors import ArgumentError
from supersampler_model.methods.base import Method
from supersampler_model.methods.weights_file import Trained


class LearnedMethod(Method):
    """Base of methods with weights.

    Attributes:
        net: the network, the only part with parameters.
        in_half: whether the stages compute colours in [0, 1] and weights in the type of the network; else
            the network alone may be in half floats.
    """

    net: nn.Module
    in_half: ClassVar[bool] = False

    def __init__(self, config: Any = None) -> None:
        super().__init__(config)
        self.net = self.make_network()

    @property
    def dtype(self) -> torch.dtype:
        """The working type: that of the network's parameters."""
        return next(self.net.parameters()).dtype

    @abstractmethod
    def make_network(self) -> nn.Module:
        """Return the untrained network, of the widths in `config`."""

    @classmethod
    def configured(cls, config: Mapping[str, Any]) -> Self:
        """Return the untrained method with the config of a weights file; what it lacks has its default."""
        return cls(_config(cls.spec.config, config))

    @classmethod
    def of(cls, trained: Trained) -> Self:
        """Return the method with trained weights, in evaluation mode.

        Raises:
            ArgumentError: they are of another method, or of another version of this one.
        """
        if trained.method != cls.name:
            raise ArgumentError("weights", got=f"of {trained.method}", want=f"of {cls.name}")
        try:
            method = cls.configured(trained.config)
            method.load_state_dict(trained.tensors)
        except (TypeError, KeyError, RuntimeError) as error:  # names that this version does not have
            got = f"of another version ({' '.join(str(error).split())})"
            want = f"of this version of {cls.name}: train it again"
            raise ArgumentError("weights", got=got, want=want) from error
        method.learned = trained.facts
        return method.eval()


def _config(kind: type[Any], plain: Mapping[str, Any]) -> Any:
    """Return a config dataclass from plain data: mappings become dataclasses, lists become tuples.

    Raises:
        TypeError: a name is no field of the dataclass.
    """
    hints = get_type_hints(kind)
    values: dict[str, Any] = {}
    for name, value in plain.items():
        if is_dataclass(hints.get(name)):
            values[name] = _config(hints[name], value)
        else:
            values[name] = tuple(value) if isinstance(value, list) else value
    return kind(**values)
