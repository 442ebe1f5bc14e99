"""Constants of the temporal denoiser, which its torch definition and its kernel share."""

REACH = 8
"""Frames to either side that a frame takes samples from."""
LOG_OFFSET = 0.01
"""Added to exposed colour before its logarithm: differences in the dark below it do not matter."""
KNOWN_SHARE = 0.999
"""Smallest interpolated share of known samples at the end of a path that counts."""
DEFAULT_SAMPLES = 8
"""Samples per pixel that are assumed where the frames do not state theirs."""
MAX_SAMPLES = 64
"""Upper limit of the samples per pixel that the filter uses. With adaptive sampling a renderer states its own
limit, often thousands, and not the samples it took."""

# The weight of a neighbour is exp(LOG_WEIGHT - AGE_COST * age - samples * distance), with the samples per
# pixel, and the sum of its distances times their costs. The frame itself has 1. The variance of noise falls
# with the samples: what may be noise at one sample is a difference at eight.
# supersampler_model.denoising.training has fitted the constants.
LOG_WEIGHT = -0.6249
COLOR_COST, COLOR_COST_3X3, COLOR_COST_5X5 = 0.0220, 0.1223, 0.2019
"""Costs of the squared difference of log colour: at the pixel, and averaged over 3x3 and 5x5 pixels."""
NORMAL_COST, NORMAL_COST_3X3 = 0.3178, 0.6003
"""Costs of the squared difference of normals: at the pixel, and averaged over 3x3 pixels."""
ALBEDO_COST, ALBEDO_COST_3X3 = 0.5483, 0.9074
"""Costs of the squared difference of albedo: at the pixel, and averaged over 3x3 pixels."""
SHIFT_COST_9X9 = 3.4943
"""Cost of the squared mean difference of log colour over 9x9 pixels and three channels. Noise averages out, a
change of light does not."""
AGE_COST = 6.0878
"""Cost of the distance in time, in frames divided by REACH."""
