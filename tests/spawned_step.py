"""A step for spawned processes, which import the function that they run."""

from noise import noise
from supersampler import Upscaler
from supersampler.frame import Float32


def image_of(seed: int) -> Float32:
    return Upscaler("taau", display_size=(64, 36), threads=2, validate="off").step(noise(seed))
