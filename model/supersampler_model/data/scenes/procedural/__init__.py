"""Procedural scenes: each family is a function that builds a random stage.

`TRAIN`, `TEST` and `APART` find them by name.
"""

from collections.abc import Callable

import numpy as np

from supersampler_model.data.scenes.procedural.court import court
from supersampler_model.data.scenes.procedural.fences import fences
from supersampler_model.data.scenes.procedural.flicker import flicker
from supersampler_model.data.scenes.procedural.floors import floors
from supersampler_model.data.scenes.procedural.foliage import foliage
from supersampler_model.data.scenes.procedural.gallery import gallery
from supersampler_model.data.scenes.procedural.machine_hall import machine_hall
from supersampler_model.data.scenes.procedural.market import market
from supersampler_model.data.scenes.procedural.metals import metals
from supersampler_model.data.scenes.procedural.movers import movers
from supersampler_model.data.scenes.procedural.night_garden import night_garden
from supersampler_model.data.scenes.procedural.rigging import rigging
from supersampler_model.data.scenes.procedural.stage import Stage
from supersampler_model.data.scenes.procedural.station import station

Family = Callable[[np.random.Generator], Stage]


def _by_name(*families: Family) -> dict[str, Family]:
    return {family.__name__: family for family in families}


TRAIN = _by_name(fences, floors, metals, movers, foliage, flicker, station)
TEST = _by_name(machine_hall, market, night_garden, gallery, court)
APART = _by_name(rigging)
