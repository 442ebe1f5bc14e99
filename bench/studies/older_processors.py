"""Step time with kernels compiled for an older x86-64 processor, measured on this one.

python bench/studies/older_processors.py avx2 --sizes 960x540
"""

import os
import platform
from enum import StrEnum
from typing import Annotated

import typer

from supersampler.cli.arguments import parse_size
from supersampler.errors import ArgumentError
from supersampler_bench.cli.options import ERRORS, JSON, UPDATE, check_page, listed, publish
from supersampler_bench.record import Record
from supersampler_bench.timing import latency

_FEATURES = (
    "sse", "sse2", "sse3", "ssse3", "sse4.1", "sse4.2", "popcnt", "avx", "avx2", "fma", "f16c", "bmi", "bmi2",
    "lzcnt", "movbe",
)  # fmt: skip
_PROCESSORS = {  # LLVM's names for the first that had them, of 2013 and 2021
    "avx2": ("haswell", _FEATURES),
    "avx-vnni": ("alderlake", (*_FEATURES, "avxvnni")),
}
_LACKS = {
    "avx2": "AVX2, but no AVX-VNNI and no AVX-512",
    "avx-vnni": "AVX2 and AVX-VNNI, but no AVX-512",
}


class Instructions(StrEnum):
    """The widest integer instructions that kernels are compiled for."""

    AVX2 = "avx2"
    AVX_VNNI = "avx-vnni"


def compile_for(instructions: str) -> None:
    """Make this process compile the kernels that it loads from now on for such a processor.

    Raises:
        ArgumentError: this machine is no x86-64.
    """
    if platform.machine().lower() not in ("x86_64", "amd64"):
        raise ArgumentError("INSTRUCTIONS", got=instructions, want="an x86-64 machine")
    name, features = _PROCESSORS[instructions]
    os.environ.update(NUMBA_CPU_NAME=name, NUMBA_CPU_FEATURES=",".join(f"+{f}" for f in features))


def markdown_table(record: Record) -> str:
    """Return the tables of `bench latency`, and for which processor the kernels were compiled."""
    lacks = _LACKS[record["instructions"]]
    return f"{latency.markdown_table(record)}\n\nKernels are compiled as for a processor that has {lacks}."


def main(
    instructions: Instructions,
    methods: Annotated[
        str, typer.Option(help="With commas between.")
    ] = "taa,taau,classifier-small,classifier",
    sizes: Annotated[str, typer.Option(help="Display sizes, with commas between.")] = "960x540",
    threads: Annotated[int, typer.Option(min=1, help="CPU threads.")] = 2,
    steps: Annotated[int, typer.Option(min=1, help="Timed steps of each setting.")] = 10,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Time a step on the CPU backend; nothing else should run."""
    compile_for(instructions)
    tables = {f"study latency {instructions}": markdown_table}
    check_page(update, tables)
    displays = [parse_size(size, "--sizes") for size in listed(sizes)]
    with ERRORS.status("timing"):
        timed = latency.measure_latency(listed(methods), displays, ["cpu"], [threads], steps=steps)
        limits = latency.measure_limits()
    record = {**latency.latency_record(timed, limits, 2.0), "instructions": instructions.value}
    publish(record, tables, json, update)


if __name__ == "__main__":
    typer.run(main)
