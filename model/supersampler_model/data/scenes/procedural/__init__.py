"""Procedural scenes: each family is a function that builds a random stage.

`TRAIN`, `TEST` and `APART` find them by name.
"""

from collections.abc import Callable

import numpy as np

from supersampler_model.data.scenes.procedural import evaluation
from supersampler_model.data.scenes.procedural.corners import moving_shadows, thin_movers
from supersampler_model.data.scenes.procedural.indoors import flicker, floors, metals, station
from supersampler_model.data.scenes.procedural.outdoors import fences, foliage, movers
from supersampler_model.data.scenes.procedural.rigging import rigging
from supersampler_model.data.scenes.procedural.stage import Stage

Family = Callable[[np.random.Generator], Stage]


def _by_name(*families: Family) -> dict[str, Family]:
    return {family.__name__: family for family in families}


TRAIN = _by_name(fences, floors, metals, movers, foliage, flicker, station)
TEST = _by_name(
    evaluation.machine_hall, evaluation.market, evaluation.night_garden, evaluation.gallery, evaluation.court
)
APART = _by_name(rigging, thin_movers, moving_shadows)
