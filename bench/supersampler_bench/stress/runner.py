"""Run scenarios one after another; record and tables of their outcomes."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler_bench.record import BenchRecord, JsonRecord, table
from supersampler_bench.stress import hostile, long_runs  # noqa: F401  # they fill FAMILIES
from supersampler_bench.stress.scenario import FAMILIES, Figure, Scenario, Subject

BAD_VALUES = "bad values"


@dataclass(frozen=True)
class ScenarioOutcome:
    """Result of one run of a scenario."""

    scenario: str
    method: str
    executor: str
    precision: str
    display: Size
    frames: int  # approximate number
    figures: tuple[Figure, ...]  # with the number of bad values; empty if the run raised
    error: str = ""  # that the run raised

    @property
    def passed(self) -> bool:
        """Whether the run raised nothing and all figures are within their bounds."""
        return not self.error and all(figure.passed for figure in self.figures)

    @property
    def subject(self) -> str:
        """Method and executor."""
        return f"{self.method} {self.executor}"


def chosen(names: Sequence[str], *, quick: bool = False) -> list[Scenario]:
    """Return the scenarios of some names or families; all without names. `quick`: only those of short runs.

    Raises:
        ArgumentError: there is no such scenario or family.
    """
    known = {scenario.name for family in FAMILIES.values() for scenario in family}
    for name in names:
        if name not in known and name not in FAMILIES:
            want = f"a family ({', '.join(FAMILIES)}) or one of: {', '.join(sorted(known))}"
            raise ArgumentError("--only", got=repr(name), want=want)
    return [
        scenario
        for family, scenarios in FAMILIES.items()
        for scenario in scenarios
        if (not names or scenario.name in names or family in names) and (scenario.quick or not quick)
    ]


def runs(scenarios: Sequence[Scenario], subjects: Sequence[Subject]) -> list[tuple[Scenario, Subject]]:
    """Return the runs of `measure`, in order."""
    return [(scenario, subject) for scenario in scenarios for subject in subjects if scenario.suits(subject)]


def left_out(scenarios: Sequence[Scenario], subjects: Sequence[Subject]) -> list[str]:
    """Return a warning for each subject that does not support the ratios of some scenarios."""
    texts = []
    for subject in subjects:
        low, high = subject.ratios
        ratios = f"only ratio is {low:g}" if low == high else f"ratios are {low:g} to {high:g}"
        if names := ", ".join(s.name for s in scenarios if not s.supports(subject)):
            texts.append(f"{subject.method} {subject.executor}, whose {ratios}, is left out of {names}")
    return texts


def measure(
    scenarios: Sequence[Scenario], subjects: Sequence[Subject], *, quick: bool = False
) -> Iterator[ScenarioOutcome]:
    """Yield the outcome of each scenario with each subject that it suits; `quick`: few and small frames."""
    for scenario, subject in runs(scenarios, subjects):
        yield run(scenario, subject, quick=quick)


def run(scenario: Scenario, subject: Subject, *, quick: bool = False) -> ScenarioOutcome:
    """Run one scenario; the outcome holds an error that it raises."""
    trial = scenario.trial(subject, quick=quick)
    figures: tuple[Figure, ...] = ()
    error = ""
    try:
        figures = (*scenario.run(trial), Figure(BAD_VALUES, float(trial.bad_values), 0.0))
    except Exception as broke:  # errors of methods are what stress looks for
        error = f"{type(broke).__name__}: {broke}"
    return ScenarioOutcome(
        scenario=scenario.name,
        method=subject.method,
        executor=subject.executor,
        precision=subject.precision,
        display=trial.display,
        frames=trial.frames,
        figures=figures,
        error=error,
    )


@dataclass(frozen=True)
class StressRecord(BenchRecord):
    """Outcomes of scenarios."""

    outcomes: list[ScenarioOutcome]
    BENCH = "stress"
    TABLES = ("", "exceeded", "scenarios")

    @classmethod
    def adapted(cls, data: JsonRecord) -> JsonRecord:
        """Return a record with NaN in place of JSON's null."""
        outcomes = [
            {**o, "figures": [{**f, "value": math.nan} if f["value"] is None else f for f in o["figures"]]}
            for o in data["outcomes"]
        ]
        return {**data, "outcomes": outcomes}

    def table(self) -> str:
        """Return a table with a row per figure and a column per subject, then a list of runs that raised."""
        outcomes = self.outcomes
        subjects = list(dict.fromkeys(o.subject for o in outcomes))
        rows = []
        for scenario in dict.fromkeys(o.scenario for o in outcomes):
            found = {o.subject: o for o in outcomes if o.scenario == scenario}
            for name in dict.fromkeys(f.name for o in found.values() for f in o.figures):
                if name != BAD_VALUES:
                    rows.append(_row(scenario, name, [found.get(subject) for subject in subjects]))
        figures = [(o.subject, f) for o in outcomes for f in o.figures]
        bad = [sum(f.value for of, f in figures if (of, f.name) == (s, BAD_VALUES)) for s in subjects]
        bold = (f"**{count:.0f}**" if count else "0" for count in bad)
        rows.append(["all of these", "values not in [0, 65504]", "0", *bold])
        within = sum(f.passed for _, f in figures)
        caption = f"All {within} figures are within their bounds."
        if within < len(figures):
            caption = f"{within} of {len(figures)} figures are within their bounds; the others are bold."
        if {o.scenario for o in outcomes} & {s.name for s in FAMILIES["recovery"]}:
            caption += (
                " After one hostile frame, the bound is the largest difference after a reset at one of "
                "five frames, if that is larger."
            )
        broken = [f"- {o.scenario}, {o.subject}: broke. {o.error}" for o in outcomes if o.error]
        headings = ["scenario", "figure", "at most:", *(f"{subject}:" for subject in subjects)]
        return "\n".join([table(headings, rows, caption), *([""] if broken else []), *broken])

    def exceeded_table(self) -> str:
        """Return the table without rows whose figures are all within their bounds."""
        *head, lines = self.table().split("\n", 2)
        kept = [line for line in lines.split("\n") if not line.startswith("|") or "**" in line]
        return "\n".join([*head, *kept] if kept[0] else kept[1:])

    def scenarios_table(self) -> str:
        """Return the table of all scenarios: those that differ only in a value share a row."""
        scenarios = (s for family in FAMILIES.values() for s in family)
        groups = groupby(scenarios, lambda s: (s.description, s.cpu or "–", s.onnx or "–"))
        rows = ([", ".join(s.name for s in group), *facts] for facts, group in groups)
        return table(["scenario", "what is done", "frames, cpu:", "onnx:"], rows)


def _row(scenario: str, name: str, found: Sequence[ScenarioOutcome | None]) -> list[str]:
    figures = [None if o is None else next((f for f in o.figures if f.name == name), None) for o in found]
    bounds = {f.bound for f in figures if f is not None}
    common = bounds.pop() if len(bounds) == 1 else None
    cells = []
    for outcome, figure in zip(found, figures, strict=True):
        if figure is None:
            cells.append("**broke**" if outcome is not None and outcome.error else "–")
            continue
        text = _number(figure.value) + (f" ({_number(figure.bound)})" if common is None else "")
        cells.append(text if figure.passed else f"**{text}**")
    return [scenario, name, "see cells" if common is None else _number(common), *cells]


def _number(value: float) -> str:
    return f"{value:.3g}" if value == 0.0 or abs(value) >= 1e-2 else f"{value:.1e}"
