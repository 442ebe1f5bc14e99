"""Operations that methods share: colour, images, motion, sampling, blending.

They have no weights and do not depend on a method. The CPU kernels and the shaders implement the same
operations. Methods write `ops.tone(color)`; `ops.at_rest` is imported as a module.
"""

from supersampler_model.ops.blending import *
from supersampler_model.ops.color import *
from supersampler_model.ops.edges import *
from supersampler_model.ops.images import *
from supersampler_model.ops.motion import *
from supersampler_model.ops.sampling import *
