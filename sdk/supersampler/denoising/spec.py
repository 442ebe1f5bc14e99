"""Constants of the temporal denoiser, which its torch definition and its kernel share."""

REACH = 8
"""Frames to either side that a frame takes samples from."""
LOG_OFFSET = 0.01
"""Added to exposed colour before its logarithm: differences in the dark below it do not matter."""
KNOWN_SHARE = 0.999
"""Smallest interpolated share of known samples at the end of a path that counts."""

# The weight of a neighbour is exp(LOG_WEIGHT - its distances times their costs); the frame itself has 1.
# supersampler_model.denoising.training has fitted them: the costs of patches, normals and albedo first, then
# the others while those were held. Fitted together, the cost of shifts replaces those of patches, and detail
# blurs.
LOG_WEIGHT = -0.3332
COLOR_COST, COLOR_COST_3X3, COLOR_COST_5X5 = 0.0406, 0.7726, 1.9646
"""Costs of the squared difference of log colour: at the pixel, and averaged over 3x3 and 5x5 pixels."""
NORMAL_COST, NORMAL_COST_3X3 = 0.5598, 1.6067
"""Costs of the squared difference of normals: at the pixel, and averaged over 3x3 pixels."""
ALBEDO_COST, ALBEDO_COST_3X3 = 0.6355, 0.7755
"""Costs of the squared difference of albedo: at the pixel, and averaged over 3x3 pixels."""
AGE_COST = 3.1036
"""Cost of the distance in time, in frames divided by REACH."""
SHIFT_COST_9X9 = 12.4576
"""Cost of the squared mean difference of log colour over 9x9 pixels and three channels. Noise averages out, a
change of light does not."""
