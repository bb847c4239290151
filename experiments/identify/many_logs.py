"""Several logs identified by one command, each by itself, and their laws side by side."""

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final

from markupsafe import Markup
from matplotlib.axes import Axes

from experiments.common import style
from experiments.common.log_names import log_names
from experiments.common.manifest import command_line, make_manifest, origin
from experiments.common.page import Answer, Bullets, Page, Plot, Section
from experiments.common.plain_json import plain, write_json
from experiments.common.results import (
    MANIFEST_FILE,
    REPORT_FILE,
    SUMMARY_FILE,
    file_names,
    write_runs,
    write_samples,
)
from experiments.common.run import Run
from experiments.common.table import MISSING, Table
from experiments.identify.config import Config
from experiments.identify.page import page as page_of_log
from experiments.identify.page import print_all
from experiments.identify.source import source_of
from trackslip.errors import LogError
from trackslip.identification.answer import TOO_LITTLE
from trackslip.identification.common_law import (
    LOGS_DIFFER,
    MULTIPLIERS,
    NOTICED,
    LogComparison,
    compare_logs,
    ratio_text,
)
from trackslip.identification.identify import identify_source
from trackslip.identification.result import Identification, identification_to_json
from trackslip.identification.source import Source
from trackslip.intervals import Gain
from trackslip.laws.families import DIFF_DRIVE, drive_laws
from trackslip.laws.file import laws_content
from trackslip.se2 import Mounting
from trackslip.views.figures import draw_costs, draw_multiplier
from trackslip.views.numbers import with_interval

_VERDICTS: Final = {"yes": "serves", "no": "doesn't serve", "can't tell": "can't tell"}
_HEADINGS: Final = {
    "yes": "One law serves all logs",
    "no": "One law doesn't serve all logs",
    "can't tell": "Can't tell whether one law serves all logs",
}
_NOTE: Final = (
    "Each log was identified by itself. Values and intervals (95 %) are those of a differential "
    "drive. Ratio: mean error of predictions by the other logs' law over that by the log's own."
)
_DOTS: Final = "Dots: values. Lines: 95 % intervals. Hollow: without an interval."
_COSTS: Final = (
    "How much larger errors are with the law of the other logs. Left of the dashed line, one law "
    "serves the log."
)
_METHOD: Final = (
    "The common law of a log has the means of the other logs' multipliers, weighted by their "
    "precision; the log's own law is fitted without the driving that it predicts. So neither law "
    "has seen what it predicts. The ratio of their mean errors says what one law for all costs "
    f"the log. It serves the log if the whole interval is below {NOTICED:g}. It doesn't if the "
    f"ratio is above {NOTICED:g}, the whole interval above 1, and a multiplier differs from that "
    "of the other logs beyond its interval (Cochran's Q): a law that is hardly known predicts "
    "badly, too. Otherwise the log can't tell. Intervals follow from the scatter between "
    "independent parts of the driving, and cover all logs together. Multipliers may differ beyond "
    "chance, and by too little to matter."
)


def run_all(config: Config) -> None:
    """Identify each log, compare the laws, and store, report and print the results."""
    names = log_names(config.logs)
    folders = file_names(names)
    stages = len(names) * (2 + len(drive_laws()))
    results: dict[str, Identification] = {}
    sources: dict[str, Source] = {}
    with Run(config) as run, run.progress("identification", stages, "stages") as step:
        sensor = None if config.sensor is None else Mounting(*config.sensor)
        for name, log in zip(names, config.logs, strict=True):
            sources[name] = source_of(config, log)
            step(1)
            with run.watch.stage(f"identify {name}"):
                try:
                    results[name] = identify_source(
                        sources[name], config.method, sensor, step, config.lag
                    )
                except LogError as error:
                    raise LogError(f"{log}: {error}") from error
        comparison = compare_logs(results)

        for name, log, folder in zip(names, config.logs, folders, strict=True):
            own = replace(config, logs=(log,), out=config.out / folder)
            _write_log(run, own, folder, results[name], sources[name])
            step(1)
        logs = [log for result in results.values() for log in result.logs]
        manifest = run.manifest(**origin(logs))
        run.write(comparison_to_json(comparison, dict(zip(names, folders, strict=True))))
        report = page(comparison, folders, manifest, str(config.out))
        report.write(run.folder, config.pdf)
    _print(comparison, report)
    if config.all:
        for name, result in results.items():
            print(f"\n{name}")
            print_all(result)
    print(f"report: {config.out / REPORT_FILE} ({run.wall:.1f} s)")


def _write_log(
    run: Run, config: Config, folder: str, result: Identification, source: Source
) -> None:
    """Write the identification of one log to a folder of its own, as for that log alone."""
    place = run.folder / folder
    place.mkdir()
    manifest = make_manifest(run.command, config, run.wall, **origin(result.logs))
    if result.logs:
        write_runs(place, result.logs)
    else:
        write_samples(place, result.samples)
    write_json(place / SUMMARY_FILE, plain(identification_to_json(result)))
    write_json(place / MANIFEST_FILE, manifest)
    title = f"Slip laws identified from “{config.logs[0].resolve().name}”"
    page_of_log(result, title, command_line("identify"), manifest, source.taken).write(
        place, config.pdf
    )


def comparison_to_json(comparison: LogComparison, folders: Mapping[str, str]) -> dict[str, Any]:
    """The content of summary.json: values of all logs, the test and, if one law serves all logs,
    that law in the form that `load_laws` reads.
    """
    content: dict[str, Any] = {}
    if comparison.verdict == "yes":
        geometry = next(iter(comparison.results.values())).geometry
        values, intervals = comparison.common_law
        stored = {DIFF_DRIVE: {"values": values, "interval95": intervals}}
        content |= laws_content(stored, geometry) | {"best": DIFF_DRIVE}
    logs = dict[str, Any]()
    for name, cost in comparison.costs.items():
        logs[name] = {
            "folder": folders[name],
            "best": comparison.results[name].best,
            "values": _json_of(comparison.values[name]),
            "ratio": cost.ratio.to_json(),
            "served": cost.verdict,
            "reason": cost.reason,
        }
    return content | {
        "logs": logs,
        "common": _json_of(comparison.common),
        "chance": plain(comparison.chance),
        "one_law": comparison.verdict,
        "reason": comparison.line,
    }


def _json_of(gains: Mapping[str, Gain]) -> dict[str, dict[str, float | None]]:
    return {key: gain.to_json() for key, gain in gains.items()}


def page(
    comparison: LogComparison, folders: Sequence[str], manifest: Mapping[str, Any], out: str
) -> Page:
    """The page on several logs, with links to the page of each."""
    links = [
        Markup('<a href="{}/{}">{}</a>, best law {}').format(folder, REPORT_FILE, name, result.best)
        for folder, (name, result) in zip(folders, comparison.results.items(), strict=True)
    ]
    plots = [
        Plot("multipliers", partial(_multiplier_panels, comparison), "Multipliers", _DOTS),
        Plot("one_law_for_all", partial(_cost_panel, comparison), "One law for all", _COSTS),
    ]
    sections = [
        Section("Logs side by side", [comparison_table(comparison), *plots]),
        Section("Reports of the logs", [Bullets(links)]),
        Section("Method", [_METHOD], folded=True),
    ]
    title = f"Slip laws of {len(folders)} logs"
    answer = _answer(comparison, folders, out)
    return Page(title, command_line("identify"), manifest, sections, answer=answer)


def _answer(comparison: LogComparison, folders: Sequence[str], out: str) -> Answer:
    facts = []
    if comparison.verdict == "yes":
        facts = [(key, _text(comparison.common[key])) for key in MULTIPLIERS]
    lines = [f"{comparison.line}.", _differences(comparison)]
    alarms = [
        f"{name}: {alarm.line}"
        for name, result in comparison.results.items()
        for alarm in result.alarms
    ]
    served = [shlex.quote(out)] if comparison.verdict == "yes" else []
    own = [shlex.quote(f"{out}/{folder}") for folder in folders]
    laws = " ".join(f"--law {folder}" for folder in [*served, *own])
    commands = [f"trackslip evaluate ANOTHER_LOG {laws}"]
    if served and not alarms:
        commands.append(f"trackslip deploy {served[0]}")
    return Answer(_HEADINGS[comparison.verdict], facts, lines, warnings=alarms, next=commands)


def _differences(comparison: LogComparison) -> str:
    """A sentence on the multipliers that differ between logs beyond chance."""
    known = {key: chance for key, chance in comparison.chance.items() if not math.isnan(chance)}
    if not known:
        return "Fewer than two logs have intervals, so whether their values differ isn't known."
    chances = ", ".join(f"{key} {_probability(chance)}" for key, chance in known.items())
    differing = comparison.differing
    what = f"{' and '.join(differing)} differ" if differing else "No value differs"
    if len(differing) == 1:
        what += "s"
    return f"{what} between the logs beyond chance (probability of such differences: {chances})."


def _probability(chance: float) -> str:
    return "< 0.001" if chance < 1e-3 else f"{chance:.2g}"


def comparison_table(comparison: LogComparison) -> Table:
    """Multipliers and cost of a common law for each log; last, the mean multipliers."""
    header = ("log", "separation", "left radius", "right radius", "ratio", "one law")
    rows = []
    for name, cost in comparison.costs.items():
        values = [
            comparison.results[name].undetermined.get(key) or _text(gain)
            for key, gain in comparison.values[name].items()
        ]
        ratio = MISSING if math.isnan(cost.ratio.value) else ratio_text(cost.ratio)
        rows.append((name, *values, ratio, _VERDICTS[cost.verdict]))
    common = [_text(comparison.common[key], LOGS_DIFFER) for key in MULTIPLIERS]
    rows.append(("mean", *common, "", ""))
    return Table("Multipliers of all logs", header, rows, "l", _NOTE)


def _text(gain: Gain, why_none: str = TOO_LITTLE) -> str:
    """A multiplier with its interval."""
    if math.isnan(gain.value):
        return MISSING
    return with_interval(gain.value, gain[1:], why_none=why_none)


def _print(comparison: LogComparison, report: Page) -> None:
    """Print the table, the verdict and the next commands."""
    comparison_table(comparison).print()
    assert report.answer is not None
    for alarm in report.answer.warnings:
        print(f"ALARM: {alarm}")
    for line in [*report.answer.lines, *(f"next: {line}" for line in report.answer.next)]:
        print(line)


@style.styled
def _multiplier_panels(comparison: LogComparison) -> style.Panels:
    """A forest plot of each multiplier."""
    panels = []
    for key in MULTIPLIERS:
        figure, axes = _forest_panel(key.replace("_", " "), comparison)
        draw_multiplier(axes, comparison, key)
        panels.append(figure)
    return tuple(panels)


@style.styled
def _cost_panel(comparison: LogComparison) -> style.Panels:
    """The cost of a common law in each log."""
    figure, axes = _forest_panel("Error by the law of the other logs", comparison)
    draw_costs(axes, comparison)
    return (figure,)


def _forest_panel(title: str, comparison: LogComparison) -> tuple[Any, Axes]:
    """A panel with a row for each log and one for their mean."""
    height = 1.3 + 0.3 * (1 + len(comparison.results))
    return style.panel(title.capitalize(), "", "", height)
