"""Kernels of `scattered_motion` and `merge_images`: compiled, never called from Python."""

import numpy as np

from supersampler.backends.cpu.simd.vector import device_function
from supersampler.sequence.backward_motion import HIDDEN, OTHER_SURFACE, REACH, SAME_SURFACE, ScatterTables
from supersampler.sequence.both_ways import MergedImages


def merge_images(images: MergedImages):
    """Write the weighted mean of two images, taken after the tone curve c / (1 + max(c))."""
    image, other, one = images.image, images.other, np.float32(1.0)
    for pixel in range(images.pixels):
        at = 3 * pixel
        a, b = images.weight[pixel], images.other_weight[pixel]
        a = a / (one + images.exposure * max(max(image[at], image[at + 1]), image[at + 2]))
        b = b / (one + images.exposure * max(max(other[at], other[at + 1]), other[at + 2]))
        share = b / max(a + b, np.float32(1e-30))
        for channel in range(3):
            value = image[at + channel]
            image[at + channel] = value + share * (other[at + channel] - value)


@device_function
def mismatch_of(a, b):
    """Return |a - b| / max(a, b), 0 where both are 0; HIDDEN where one is not finite."""
    difference = abs(a - b) / max(max(abs(a), abs(b)), np.float32(1e-30))
    return difference if difference < np.float32(HIDDEN) else np.float32(HIDDEN)


def scatter_motion(tables: ScatterTables):
    """Write the motion to the next frame: scattered where a sample's depth fits, else of a near pixel."""
    motion, mismatch, depth = tables.motion, tables.mismatch, tables.depth
    width, height = tables.width, tables.height
    for pixel in range(width * height):
        mismatch[pixel] = np.float32(HIDDEN)
        motion[2 * pixel], motion[2 * pixel + 1] = np.float32(0.0), np.float32(0.0)
    half = np.float32(0.5)
    for row in range(tables.next_height):
        for column in range(tables.next_width):
            sample = row * tables.next_width + column
            along, down = tables.next_motion[2 * sample], tables.next_motion[2 * sample + 1]
            x = (np.float32(column) + along) * tables.scale_x + tables.shift_x + half
            y = (np.float32(row) + down) * tables.scale_y + tables.shift_y + half
            if x >= 0.0 and x < np.float32(width) and y >= 0.0 and y < np.float32(height):  # False for NaN
                to = np.int64(y) * width + np.int64(x)
                fit = mismatch_of(depth[to], tables.next_depth[sample])
                if fit <= np.float32(SAME_SURFACE) and fit <= mismatch[to]:
                    mismatch[to] = fit
                    motion[2 * to], motion[2 * to + 1] = -along * tables.scale_x, -down * tables.scale_y
    for row in range(height):
        for column in range(width):
            pixel = row * width + column
            if mismatch[pixel] < np.float32(HIDDEN):
                continue
            best, source = np.int64(4 * OTHER_SURFACE), np.int64(-1)
            for reach in range(1, REACH + 1):  # ring by ring
                if best < reach * reach:  # all others are farther away
                    break
                for y in range(max(row - reach, 0), min(row + reach + 1, height)):
                    across = 1 if abs(y - row) == reach else 2 * reach  # of the other rows, both ends
                    for x in range(column - reach, column + reach + 1, across):
                        near = y * width + x
                        if x >= 0 and x < width and mismatch[near] < np.float32(HIDDEN):
                            cost = (y - row) * (y - row) + (x - column) * (x - column)
                            if mismatch_of(depth[pixel], depth[near]) > np.float32(SAME_SURFACE):
                                cost += OTHER_SURFACE
                            if cost < best:
                                best, source = cost, near
            if source >= 0:
                motion[2 * pixel], motion[2 * pixel + 1] = motion[2 * source], motion[2 * source + 1]
