"""`supersampler bench hashes`: whether two versions compute the same images, bit for bit."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from supersampler.errors import ArgumentError
from supersampler_bench.cli.options import JSON, counted, listed, publish, say, warn
from supersampler_bench.record import read_record, setting


def hashes(
    methods: Annotated[
        str | None, typer.Option(help="Names of shipped models, with commas between.", show_default="all")
    ] = None,
    json: JSON = None,
    check: Annotated[
        Path | None,
        typer.Option(metavar="RECORD", help="Compare with this earlier record; fail where anything differs."),
    ] = None,
) -> None:
    """Hash every image of the shipped models, at five sizes, in every way that they run on a CPU.

    Hashes depend on the processor: compare records of one machine. bench/results/today has those that later
    versions are compared with.

    \b
    Examples:
      supersampler bench hashes --json hashes.json
      supersampler bench hashes --methods classifier --check bench/results/today/hashes.json
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.agreement.hashes import (
        SIZES,
        differences,
        hashes_record,
        markdown_table,
        measure_hashes,
        other_setting,
        subjects,
    )

    before = None if check is None else read_record(check)
    if before is not None and before["bench"] != "hashes":
        raise ArgumentError(
            "--check", got=f"{check}, of `bench {before['bench']}`", want="one of `bench hashes`"
        )
    chosen = None if methods is None else listed(methods)
    hashed = subjects(chosen)
    with counted("runs", len(SIZES) * len(hashed)) as advance:
        results = measure_hashes(hashed, SIZES, on_run=advance)
    record = hashes_record(results)
    publish(record, {"hashes": markdown_table}, json, None)
    if before is None:
        return
    here = {**record, **setting()}
    found = list(differences(before, here, partly=chosen is not None))
    for text in found:
        Console().print(text, markup=False, soft_wrap=True)
    say(f"{len(results)} runs: {len(found)} differ from {check}")
    if found:
        if unlike := other_setting(before, here):
            warn(unlike)
        raise typer.Exit(1)
