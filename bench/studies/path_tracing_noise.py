"""How far the history averages the noise of a path tracer: examples/mitsuba_sequence.py, as a record.

    python bench/studies/path_tracing_noise.py --json FILE --update docs/tutorials/shot.md

Needs `pip install . mitsuba`, and an LLVM of the system: see the example.
"""

import runpy
from pathlib import Path
from typing import Annotated

import typer

from supersampler_bench.cli.options import JSON, UPDATE, check_page, listed, publish
from supersampler_bench.markdown_table import figure, table
from supersampler_bench.record import Record, machine_name

EXAMPLE = Path(__file__).parents[2] / "examples" / "mitsuba_sequence.py"


def markdown_table(record: Record) -> str:
    """Return the table of a record, with its caption."""
    names = list(record["rows"][-1]["psnr"])
    cells = [
        [row["samples"], *(figure(row["psnr"].get(name), 1) for name in names)] for row in record["rows"]
    ]
    caption = (
        f"PSNR in dB of frame {record['frames']} of a Cornell box around which the camera turns, "
        f"{record['size']}x{record['size']} to twice the size, against {record['reference_samples']} "
        f"samples a pixel. Mitsuba {record['mitsuba']}; {machine_name(record)}."
    )
    return table(["samples a render pixel:", *(f"{name}:" for name in names)], cells, caption)


def main(
    samples: Annotated[str, typer.Option(help="Of a render pixel, with commas between.")] = "1,4,16",
    frames: Annotated[int, typer.Option(help="Of the sequence.")] = 24,
    size: Annotated[int, typer.Option(help="Width and height of the render.")] = 128,
    reference_samples: Annotated[int, typer.Option(help="Of a pixel of the reference.")] = 1024,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Measure the noise that is left, by number of samples."""
    tables = {"study path tracing noise": markdown_table}
    check_page(update, tables)
    example = runpy.run_path(str(EXAMPLE))
    rows = list(example["measure"]([int(each) for each in listed(samples)], frames, size, reference_samples))
    record = {
        "bench": "path_tracing_noise",
        "mitsuba": example["mi"].__version__,
        "frames": frames,
        "size": size,
        "reference_samples": reference_samples,
        "rows": rows,
    }
    publish(record, tables, json, update)


if __name__ == "__main__":
    typer.run(main)
