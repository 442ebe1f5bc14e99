"""The table of pyvista_frames.py, which needs no PyVista."""

from statistics import median

from supersampler_bench.markdown_table import figure, size_text, table
from supersampler_bench.record import Record, machine_name

WAYS = {"none": "none", "msaa": "MSAA", "ssaa": "SSAA"}
"""PyVista's own ways of anti-aliasing, by name; others are models of `enable_supersampling`."""


def markdown_table(record: Record) -> str:
    """Return the table of a record, with its caption."""
    (msaa,) = (median(row["seconds"]) for row in record["rows"] if row["way"] == "msaa")
    cells = []
    for row in record["rows"]:
        seconds = row["seconds"]
        cells.append(
            [
                WAYS.get(row["way"], f"`{row['way']}`, half size" if record["scale"] == 2 else row["way"]),
                f"{1000 * median(seconds):.0f} ({1000 * min(seconds):.0f} to {1000 * max(seconds):.0f})",
                figure(median(seconds) / msaa, 2),
                figure(1000 * median(row["step"]), 1) if row["step"] else "–",
                figure(1000 * median(row["glue"]), 1) if row["glue"] else "–",
                figure(row["psnr"], 2),
                figure(row["psnr_at_rest"], 2),
            ]
        )
    headings = ["anti-aliasing", "ms a frame:", "of MSAA's:", "step ms:", "glue ms:", "PSNR dB:", "at rest:"]
    caption = (
        f"A frog of {record['cells']:,} cells; the camera turns by {record['turn']:g} degrees a frame, a "
        f"ring moves; {size_text(record['display_size'])}. Medians of {record['frames'] - record['warm_up']} "
        f"frames, with the least and the most; all ways take turns. MSAA of {record['msaa_samples']} "
        f"samples. PSNR of the last {record['compared']} frames against 64 samples a pixel, of display "
        f"values; at rest after {record['rest']} more of the last view. Glue is the time of a frame without "
        f"VTK's renders and the method's step. {record['opengl']}; VTK {record['vtk']}; "
        f"{machine_name(record)}."
    )
    return table(headings, cells, caption)
