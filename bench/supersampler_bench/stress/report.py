"""Results of a stress run: a table, a record, a sheet of curves for each family."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure as Sheet
from matplotlib.ticker import MaxNLocator

from supersampler.io.files import replacing
from supersampler_bench.markdown_table import table
from supersampler_bench.record import Record
from supersampler_bench.stress.runner import BAD_VALUES, FAMILIES, Outcome
from supersampler_bench.stress.scenario import Figure, Scenario

_STYLES = {"cpu": "-", "onnx": "--"}
_COLUMNS = 3  # of a sheet


def stress_record(outcomes: Sequence[Outcome], *, quick: bool) -> dict[str, Any]:
    """Return all values but the curves, ready for JSON."""
    return {
        "bench": "stress",
        "quick": quick,
        "outcomes": [
            {**{k: v for k, v in asdict(o).items() if k != "curve"}, "passed": o.passed} for o in outcomes
        ],
    }


def outcomes_of(record: Record) -> list[Outcome]:
    """Return what `stress_record` was made of, without curves."""
    outcomes = []
    for row in record["outcomes"]:
        figures = tuple(Figure(f["name"], _number_of(f["value"]), f["bound"]) for f in row["figures"])
        known = {name: value for name, value in row.items() if name != "passed"}
        outcomes.append(Outcome(**{**known, "figures": figures, "curve": []}))
    return outcomes


def _number_of(value: float | None) -> float:
    return float("nan") if value is None else value


def markdown_table(record: Record) -> str:
    """Return the table of a record as Markdown, and a list of the runs that raised.

    Each row is a figure, each column a method and executor.
    """
    outcomes = outcomes_of(record)
    subjects = list(dict.fromkeys((o.method, o.executor) for o in outcomes))
    rows = []
    for scenario in dict.fromkeys(o.scenario for o in outcomes):
        found = {(o.method, o.executor): o for o in outcomes if o.scenario == scenario}
        for name in dict.fromkeys(f.name for o in found.values() for f in o.figures):
            if name != BAD_VALUES:
                rows.append(_row(scenario, name, [found.get(subject) for subject in subjects]))
    rows.append(_bad_values(outcomes, subjects))
    headings = ["scenario", "figure", "at most:", *(f"{method} {executor}:" for method, executor in subjects)]
    return "\n".join([table(headings, rows, _caption(outcomes)), *_broken(outcomes)])


def scenario_list() -> str:
    """Return as Markdown what each scenario does, and for how many frames."""
    scenarios = (s for family in FAMILIES.values() for s in family)
    rows = ([s.name, s.done, s.cpu or "–", s.onnx or "–"] for s in scenarios)
    return table(["scenario", "what is done", "frames, cpu:", "onnx:"], rows)


def _row(scenario: str, name: str, found: Sequence[Outcome | None]) -> list[str]:
    figures = [None if o is None else next((f for f in o.figures if f.name == name), None) for o in found]
    bounds = {f.bound for f in figures if f is not None}
    common = bounds.pop() if len(bounds) == 1 else None
    cells = [_cell(outcome, figure, common) for outcome, figure in zip(found, figures, strict=True)]
    bound = "see cells" if common is None else _number(common)
    return [scenario, name, bound, *cells]


def _cell(outcome: Outcome | None, figure: Figure | None, common: float | None) -> str:
    if outcome is None or figure is None:
        return "**broke**" if outcome is not None and outcome.error else "–"
    text = _number(figure.value)
    if common is None:
        text += f" ({_number(figure.bound)})"
    return text if figure.passed else f"**{text}**"


def _number(value: float) -> str:
    return f"{value:.3g}" if value == 0.0 or abs(value) >= 1e-2 else f"{value:.1e}"


def _bad_values(outcomes: Sequence[Outcome], subjects: Sequence[tuple[str, str]]) -> list[str]:
    cells = []
    for subject in subjects:
        figures = [f for o in outcomes if (o.method, o.executor) == subject for f in o.figures]
        bad = sum(f.value for f in figures if f.name == BAD_VALUES)
        cells.append(f"**{bad:.0f}**" if bad else "0")
    return ["all of these", "values not in [0, 65504]", "0", *cells]


def _caption(outcomes: Sequence[Outcome]) -> str:
    figures = [f for o in outcomes for f in o.figures]
    within = sum(f.passed for f in figures)
    text = f"{within} of {len(figures)} figures are within their bounds; those that are not are bold."
    if {o.scenario for o in outcomes} & {s.name for s in FAMILIES["recovery"]}:
        text += " After one hostile frame, the bound is the largest difference after a reset at one of five "
        text += "frames, if that is larger."
    return text


def _broken(outcomes: Sequence[Outcome]) -> list[str]:
    lines = [f"- {o.scenario}, {o.method} {o.executor}: broke. {o.error}" for o in outcomes if o.error]
    return ["", *lines] if lines else []


def draw_sheets(outcomes: Sequence[Outcome], folder: Path) -> list[Path]:
    """Draw a sheet for each family that was run, a panel a scenario, and return their paths."""
    paths = []
    for family, scenarios in FAMILIES.items():
        names = {o.scenario for o in outcomes}
        run = [s for s in scenarios if s.name in names]
        if run:
            paths.append(folder / f"{family}.png")
            _draw_sheet(run, outcomes, paths[-1])
    return paths


def _draw_sheet(scenarios: Sequence[Scenario], outcomes: Sequence[Outcome], path: Path) -> None:
    methods = list(dict.fromkeys(o.method for o in outcomes))
    columns = min(_COLUMNS, len(scenarios))
    rows = -(-len(scenarios) // columns)
    sheet = Sheet(figsize=(5.5 * columns, 3.6 * rows + 0.6), layout="constrained")
    panels = sheet.subplots(rows, columns, squeeze=False).flat
    for axes, scenario in zip(panels, scenarios, strict=False):
        _draw_panel(axes, scenario, [o for o in outcomes if o.scenario == scenario.name], methods)
    for axes in list(sheet.axes)[len(scenarios) :]:
        axes.remove()
    handles = {str(line.get_label()): line for axes in sheet.axes for line in axes.lines}
    sheet.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=6, fontsize="small")
    with replacing(path) as partial:
        sheet.savefig(partial, format="png")


def _draw_panel(axes: Axes, scenario: Scenario, outcomes: Sequence[Outcome], methods: Sequence[str]) -> None:
    high, across = scenario.curve.split(" / ")
    for o in outcomes:
        label, color = f"{o.method} {o.executor}", f"C{methods.index(o.method)}"
        marker = "o" if len(o.curve) < 8 else ""
        axes.plot(
            range(1, len(o.curve) + 1),
            o.curve,
            _STYLES[o.executor],
            color=color,
            label=label,
            marker=marker,
            lw=1.0,
        )
    axes.set(title=scenario.name, xlabel=across, ylabel=high)
    if scenario.logarithmic:
        axes.set_yscale("symlog", linthresh=1e-7)
        axes.set_ylim(bottom=0.0)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(alpha=0.3)
