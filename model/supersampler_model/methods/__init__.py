"""One file per method; `METHODS` finds them by name."""

from collections.abc import Mapping

from supersampler_model.method import Method
from supersampler_model.methods.spatial import Bicubic, Bilinear
from supersampler_model.methods.taa import Taa
from supersampler_model.methods.taau import Taau

METHODS: Mapping[str, type[Method]] = {m.name: m for m in (Bilinear, Bicubic, Taa, Taau)}
