"""Start the training of a method; the registry names its task."""

from supersampler.methods.registry import load, methods
from supersampler_model.methods import learned_method
from supersampler_model.methods.base import Trained
from supersampler_model.training.task import Task


def start_task(name: str, weights: Trained | None = None) -> Task:
    """Return the training task of a method.

    Args:
        name: name of the method.
        weights: to start from: its own, or those of `classifier` where the method extends that; None: random.

    Raises:
        ArgumentError: there is no such method, nothing in it is learned, or it cannot start from the weights.
    """
    kind = learned_method(name)
    if weights is None:
        method = kind()
    elif weights.method == name:
        method = kind.of(weights)
    else:
        method = getattr(kind, "from_classifier", kind.of)(weights)
    task: Task = load(methods()[name].task)(method)
    return task
