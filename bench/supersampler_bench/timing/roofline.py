"""Least time of a step on named GPUs, computed from what it moves and their published figures."""

from typing import NamedTuple

from supersampler_bench.markdown_table import size_text, table
from supersampler_bench.record import Record


class Gpu(NamedTuple):
    """Published figures of a GPU.

    Attributes:
        name: of the product.
        bandwidth: of its memory, GB/s.
        multiply_adds: in single precision, 10^12 a second: half its TFLOPS.
        dot4: whether it multiplies and adds four bytes at once, at four times that rate.
    """

    name: str
    bandwidth: float
    multiply_adds: float
    dot4: bool = True


GPUS = (
    Gpu("NVIDIA H200", 4800.0, 33.5),
    Gpu("NVIDIA H100 SXM", 3350.0, 33.5),
    Gpu("GeForce RTX 4090", 1008.0, 41.3),
    Gpu("GeForce RTX 3090", 936.0, 17.8),
    Gpu("GeForce RTX 3060", 360.0, 6.4),
    Gpu("Radeon RX 7900 XTX", 960.0, 30.7),
    Gpu("Radeon RX 6600", 224.0, 4.5),
    Gpu("Arc A770", 560.0, 9.8),
    Gpu("Apple M2", 100.0, 1.8, dot4=False),
)
"""Vendors' specifications, boost clocks."""


def least_ms(gpu: Gpu, moved: int, multiply_adds: int) -> float:
    """Return the time of a step at the GPU's full bandwidth or arithmetic, whichever is longer, milliseconds.

    Args:
        gpu: the GPU.
        moved: bytes.
        multiply_adds: of the network.
    """
    rate = gpu.multiply_adds * (4.0 if gpu.dot4 else 1.0)
    return max(moved / (gpu.bandwidth * 1e6), multiply_adds / (rate * 1e9))


def roofline_table(record: Record) -> str:
    """Return the computed times of a record of `bench traffic` as Markdown, with its caption."""
    steps = [(size, row) for size in record["sizes"] for row in size["steps"] if row["backend"] == "gpu"]
    sizes = [f"{size_text(size['render'])} to {size_text(size['display'])}" for size, _ in steps]
    headings = ["GPU", *(f"{row['method']}, {size}:" for (_, row), size in zip(steps, sizes, strict=True))]
    rows = [
        [gpu.name, *(f"{least_ms(gpu, row['bytes'], row['multiply_adds']):.2f}" for _, row in steps)]
        for gpu in GPUS
    ]
    caption = (
        "**Computed, not measured**: milliseconds of a step at the published bandwidth of the memory, or at "
        "the published arithmetic for the multiply-adds of the network, whichever is longer. No step is "
        "faster; arithmetic beside the network and dispatches come on top."
    )
    return table(headings, rows, caption)
