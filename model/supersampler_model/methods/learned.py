"""Base of methods with weights: built from a config, then loaded with weights of that config."""

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, Self

from supersampler.errors import ArgumentError
from supersampler_model.methods.base import Method
from supersampler_model.methods.weights_file import Trained


class LearnedMethod(Method):
    """Base of methods with weights."""

    @classmethod
    @abstractmethod
    def configured(cls, config: Mapping[str, Any]) -> Self:
        """Return the untrained method with the config of a weights file."""

    @classmethod
    def of(cls, trained: Trained) -> Self:
        """Return the method with trained weights, in evaluation mode.

        Raises:
            ArgumentError: they are of another method.
        """
        if trained.method != cls.name:
            raise ArgumentError("weights", got=f"of {trained.method}", want=f"of {cls.name}")
        method = cls.configured(trained.config)
        method.load_state_dict(trained.tensors)
        method.learned = trained.facts
        return method.eval()
