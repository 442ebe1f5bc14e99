"""Start the training of a method; the registry names its task."""

from supersampler.methods.registry import load, methods
from supersampler_model.methods import learned_method
from supersampler_model.methods.base import Trained
from supersampler_model.training.task import Task


def start_task(name: str, weights: Trained | None = None) -> Task:
    """Return the training task of a method.

    Args:
        name: name of the method.
        weights: initial weights of the method, or of `classifier` if the method extends it; None: random.

    Raises:
        ArgumentError: the method does not exist or is not trainable, or the weights do not fit.
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
