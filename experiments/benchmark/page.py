"""The page of a benchmark: leaderboard, lost paths, figures, all rows."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow.parquet

from experiments.benchmark import figures
from experiments.benchmark.cases import Case
from experiments.benchmark.rows import BenchmarkRow, BoardEntry, CaseRow
from experiments.benchmark.table import board_table, whole_table
from experiments.report.figures.style import law_line
from experiments.report.page import Bullets, Page, Plot, Section, file_name
from experiments.storage.manifest import relative
from trackslip.logs.table_reader import runs_from_table

_FAVOURITES = ("icr_radius", "online", "icr", "published", "none")  # compensations to compare controllers with
_REPRESENTATIVES = ("linear", "feedforward")  # controllers to compare compensations with
_INTRO = (
    "Every controller drives every path on every ground, with each slip compensation. Seeds, starts and scanner noise"
    " are the same for all. The position error is the distance between the robot's true position and the reference at"
    " the same time. A run keeps the path if this distance never exceeds 0.5 m."
)
_BOARD_CAPTION = (
    "Root mean square from 12 s on (for shorter runs, over the whole run), averaged over references and seeds. Lines"
    " span the best to the worst reference. Open symbols mark controllers that lost the path in at least one run."
)


def page(
    runs_file: Path,
    entries: Sequence[BoardEntry],
    lost: Sequence[str],
    rows: Sequence[BenchmarkRow],
    runs: Sequence[CaseRow],
    manifest: Mapping[str, Any],
    command: str,
) -> Page:
    """The page, with figures of `runs`, whose logs are in the Parquet file `runs_file`."""
    heading = "Position error by controller, compensation and ground"
    plot = Plot("leaderboard", figures.board(rows), heading, _BOARD_CAPTION)
    lost_paths = Section("Lost paths", [Bullets(lost)]) if lost else None
    return Page(
        "Controllers of a tracked robot, with and without compensation of slip",
        command,
        manifest,
        [
            Section("Leaderboard", [plot, board_table(entries), lost_paths]),
            Section("Paths", list(_path_plots(runs_file, [run.case for run in runs if run.error is None]))),
            Section("All rows", [whole_table(rows)]),
        ],
        intro=[_INTRO],
    )


def _path_plots(runs_file: Path, cases: Sequence[Case]) -> Iterator[Plot]:
    """Per reference: controllers side by side, and one controller with each compensation; first ground and seed."""
    for name in dict.fromkeys(case.reference for case in cases):
        here = [case for case in cases if case.reference == name]
        here = [case for case in here if (case.ground, case.seed) == (here[0].ground, here[0].seed)]
        compensations = dict.fromkeys(case.compensation for case in here)
        controllers = list(dict.fromkeys(case.controller for case in here))
        if len(controllers) > 1:
            at_start = {start: [case for case in here if case.start == start] for start in (c.start for c in here)}
            most = max(at_start.values(), key=lambda some: len({case.controller for case in some}))
            favourite = next((c for c in (*_FAVOURITES, *compensations) if c in compensations), "none")
            alike = [case for case in most if case.compensation == favourite]
            style = {key: figures.controller_line(k) for k, key in enumerate(controllers)}
            what = f"All with {figures.compensation_name(favourite)}"
            yield _plot(runs_file, _first(alike, "controller"), style, f"{relative(name)}: controllers", what)
        if len(compensations) > 1:
            representatives = dict.fromkeys(c for c in (*_REPRESENTATIVES, *controllers) if c in controllers)
            for controller in [*representatives][:2]:
                one = [case for case in here if case.controller == controller]
                chosen = _first([case for case in one if case.start == one[0].start], "compensation")
                heading = f"{relative(name)}: {relative(controller)} with each compensation"
                yield _plot(runs_file, chosen, {key: law_line(key) for key in chosen}, heading, "")


def _first(cases: Sequence[Case], key: str) -> dict[str, Case]:
    """The first case for each value of the field `key`."""
    values = [getattr(case, key) for case in cases]
    return {value: cases[values.index(value)] for value in values}


def _plot(
    runs_file: Path, chosen: Mapping[str, Case], style: Mapping[str, Mapping[str, object]], heading: str, what: str
) -> Plot:
    table = pyarrow.parquet.read_table(runs_file, filters=[("run", "in", [case.name for case in chosen.values()])])
    logs = {log.run: log for log in runs_from_table(table, str(runs_file)).runs}
    one = next(iter(chosen.values()))
    lines = {figures.compensation_name(key): (logs[case.name], dict(style[key])) for key, case in chosen.items()}
    caption = f"{what + ', o' if what else 'O'}n {relative(one.ground)}, start {one.start}, seed {one.seed}."
    return Plot(f"paths_{file_name(heading)}", figures.paths(one.reference, lines), heading, caption)
