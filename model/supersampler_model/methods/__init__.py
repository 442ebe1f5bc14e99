"""The methods as torch modules, one file per method; `method_class` and `load_method` find them by name.

`base` has their base classes. Large methods have more files (`classifier_network`, `gbuffer_surfaces`).
"""

from pathlib import Path
from typing import cast

from supersampler.errors import ArgumentError, did_you_mean
from supersampler.methods.registry import load, methods
from supersampler_model.methods.base import LearnedMethod, Method, load_trained, shipped_weights


def method_class(name: str) -> type[Method]:
    """Return the torch module of a method.

    Raises:
        ArgumentError: there is no such method.
    """
    known = methods()
    if name not in known:
        want, hint = f"one of {', '.join(known)}", did_you_mean(name, known)
        raise ArgumentError("METHOD", got=name, want=want, hint=hint)
    return cast("type[Method]", load(known[name].torch))


def learned_method(name: str) -> type[LearnedMethod]:
    """Return the torch module of a method with a network.

    Raises:
        ArgumentError: there is no such method, or it has no network.
    """
    method = method_class(name)
    if not issubclass(method, LearnedMethod):
        want = f"one of {', '.join(name for name, spec in methods().items() if spec.task)}"
        raise ArgumentError("METHOD", got=name, want=want)
    return method


def load_method(name: str, weights: Path | None = None) -> Method:
    """Return a method in evaluation mode, with the weights of a file, or with the released ones.

    Raises:
        ArgumentError: there is no such method, it has no weights, or the file has none for it.
    """
    method = method_class(name)
    if issubclass(method, LearnedMethod):
        return method.of(load_trained(weights or shipped_weights(name)))
    if weights is not None:
        raise ArgumentError("--weights", got=weights, want="none, as nothing in it is learned")
    return method().eval()
