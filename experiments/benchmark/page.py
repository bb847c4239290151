"""The page of a benchmark: leaderboard, lost paths, paths, all rows."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.benchmark import figures
from experiments.benchmark.cases import Case
from experiments.benchmark.table import board_table, whole_table
from experiments.report.figures.style import law_line
from experiments.report.page import Bullets, Page, Plot, Section, file_name
from experiments.storage.manifest import command_line, relative
from experiments.sweep.parts import Row
from trackslip.logs.logfile import StoredRuns

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
    entries: Sequence[Row],
    lost: Sequence[str],
    rows: Sequence[Row],
    driven: Sequence[Case],
    manifest: Mapping[str, Any],
) -> Page:
    """The page, with figures of the cases `driven`, whose logs are in the Parquet file `runs_file`."""
    heading = "Position error by controller, compensation and ground"
    plot = Plot("leaderboard", figures.board(rows), heading, _BOARD_CAPTION)
    return Page(
        "Controllers of a tracked robot, with and without compensation of slip",
        command_line("benchmark"),
        manifest,
        [
            Section("Leaderboard", [plot, board_table(entries), Section("Lost paths", [Bullets(lost)])]),
            Section("Paths", list(_path_plots(runs_file, driven))),
            Section("All rows", [whole_table(rows)]),
        ],
        intro=[_INTRO],
    )


def _path_plots(runs_file: Path, cases: Sequence[Case]) -> Iterator[Plot]:
    """Per reference: controllers side by side, and one controller with each compensation; first ground and seed."""
    for name in dict.fromkeys(case.reference for case in cases):
        first = next(case for case in cases if case.reference == name)
        here = [case for case in cases if (case.reference, case.ground, case.seed) == (name, first.ground, first.seed)]
        controllers = list(dict.fromkeys(case.controller for case in here))
        laws = list(dict.fromkeys(case.compensation for case in here))
        if len(controllers) > 1:
            favourite = next(law for law in (*_FAVOURITES, *laws) if law in laws)
            same = [case for case in here if case.compensation == favourite]
            chosen = {case.controller: case for case in same if case.start == same[0].start}
            looks = {key: figures.controller_line(k) for k, key in enumerate(controllers)}
            what = f"All with {figures.compensation_name(favourite)}, on"
            yield _plot(runs_file, chosen, looks, f"{relative(name)}: controllers", what)
        if len(laws) > 1:
            preferred = [one for one in _REPRESENTATIVES if one in controllers]
            for controller in list(dict.fromkeys([*preferred, *controllers]))[:2]:
                same = [case for case in here if case.controller == controller]
                chosen = {case.compensation: case for case in same if case.start == same[0].start}
                heading = f"{relative(name)}: {relative(controller)} with each compensation"
                yield _plot(runs_file, chosen, {law: law_line(law) for law in chosen}, heading, "On")


def _plot(
    runs_file: Path, chosen: Mapping[str, Case], looks: Mapping[str, Mapping[str, Any]], heading: str, what: str
) -> Plot:
    runs, one = StoredRuns(runs_file), next(iter(chosen.values()))
    lines = {figures.compensation_name(key): (runs.log(case.name), dict(looks[key])) for key, case in chosen.items()}
    caption = f"{what} {relative(one.ground)}, start {one.start}, seed {one.seed}."
    return Plot(f"paths_{file_name(heading)}", figures.paths(one.reference, lines), heading, caption)
