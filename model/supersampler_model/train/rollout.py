"""One recurrent step of a batch of crops: gathered one by one, as ratios differ, classified together."""

from typing import NamedTuple

import torch
from torch import Tensor

from supersampler_model.method import render_size_of
from supersampler_model.methods.classifier import Classifier
from supersampler_model.methods.classifier_buffers import History
from supersampler_model.sampling import View
from supersampler_model.train.windows import Sample


class State(NamedTuple):
    """What one crop's frame left."""

    history: History
    view: View


class Drawn(NamedTuple):
    """What a step says of the batch."""

    images: Tensor  # (n, 3, H, W) linear RGB
    logits: Tensor  # (n, 6, H / 2, W / 2)
    off_screen: Tensor  # (n, 1, H, W) 1 where there is no past


def first_state(method: Classifier, sample: Sample) -> State:
    """No past."""
    empty = method.first_history(sample.view.display, render_size_of(sample.color))
    color, state, classes, depth, _, exposure = (t.to(sample.color.device) for t in empty)
    return State(History(color, state, classes, depth, exposure), sample.view)


def step(method: Classifier, samples: list[Sample], states: list[State]) -> tuple[Drawn, list[State]]:
    """Step every crop once; gradients flow through the colour of the history alone."""
    gathered = [
        method.gather(s.color, s.depth, s.motion, s.exposure, state.history, s.view, state.view)
        for s, state in zip(samples, states, strict=True)
    ]
    packed, carried = (torch.cat(parts) for parts in zip(*(method.seen(g) for g in gathered), strict=True))
    with torch.autocast(packed.device.type, torch.bfloat16, enabled=method.training):
        logits, mixing = method.net(packed, carried)
    logits, mixing = logits.float(), mixing.float()
    images, after = [], []
    for i, (g, sample) in enumerate(zip(gathered, samples, strict=True)):
        done = method.finish(g, logits[i : i + 1], mixing[i : i + 1])
        left = History(done.image, done.state.detach(), done.classes.detach(), g.surfaces, g.exposure)
        images.append(done.image)
        after.append(State(left, sample.view))
    off_screen = torch.cat([1.0 - g.there.on_screen for g in gathered])
    return Drawn(torch.cat(images), logits, off_screen), after


def detached(state: State) -> State:
    """Cut the gradient off."""
    return state._replace(history=state.history._replace(color=state.history.color.detach()))
