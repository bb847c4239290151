"""`trackslip identify`: slip laws from a stored grid or from a real robot's log."""

from __future__ import annotations

import time
from functools import partial

from experiments.options.identify import IdentifyConfig
from experiments.report.terminal import print_table
from experiments.storage.manifest import command_line, make_manifest
from experiments.storage.plain_json import plain, write_json
from experiments.storage.results import (
    MANIFEST_FILE,
    REPORT_FILE,
    SUMMARY_FILE,
    results_folder,
    write_runs,
    write_samples,
)
from experiments.sweep.choose import chosen
from trackslip.identification.comparison import Comparison
from trackslip.identification.identify import identified
from trackslip.identification.source import Reading, Source, origin, read_source
from trackslip.identification.summary import identification_to_json
from trackslip.slip.families import FAMILIES


def run(config: IdentifyConfig) -> None:
    """Fit the laws, store and print them."""
    from experiments.report.reproduction import (  # late: others read logs with this module, and draw nothing
        Report,
        render,
    )

    began = time.perf_counter()
    with results_folder(config.out) as folder:
        source = source_of(config)
        found = identified(source)
        summary = identification_to_json(found)
        wall = time.perf_counter() - began
        summary["timing"] = {"wall_s": wall, "stages": {"identify": wall}}
        about = make_manifest("identify", config, wall, **origin(source.logs))
        if source.logs:
            write_runs(folder, source.logs)
        else:
            write_samples(folder, source.sampling.samples)
        write_json(folder / SUMMARY_FILE, summary)
        write_json(folder / MANIFEST_FILE, about)
        page = Report(
            title=f"Slip laws identified from {config.path.name}",
            command=command_line("identify"),
            manifest=about,
            summary=plain(summary),
            comparison=(),
            grid_logs=source.logs,
            identification=found,
        )
        render(page).write(folder, config.pdf)
    runs = len(found.samples)
    print_table(f"Slip laws from {runs} runs", LAW_HEADER, law_rows(found.comparison))
    print_table("Laws compared, the best first", COMPARISON_HEADER, comparison_rows(found.comparison))
    for warning in found.warnings:
        print(f"warning: {warning}")
    print(f"best: {found.comparison.best}, {FAMILIES[found.comparison.best].title}")
    print(f"{config.out / REPORT_FILE}: {time.perf_counter() - began:.1f} s")


def source_of(config: IdentifyConfig) -> Source:
    """The samples that the options name; raises LogError or InvalidValueError if none can be used."""
    reading = Reading(config.half_gauge, config.sprocket_radius, config.gear, config.settle, config.motion)
    return read_source(config.path, reading, partial(chosen, where=config.where) if config.where else None)


LAW_HEADER = ("law", "parameter", "value", "std. error", "95 % interval", "by bootstrap")
COMPARISON_HEADER = ("law", "free", "rms", "AICc", "weight", "cv radius", "cv speed", "cv yaw rate", "lack of fit")
SYMBOLS = {
    "alpha_outer": "alpha outer",
    "beta_outer": "beta outer",
    "alpha_inner": "alpha inner",
    "beta_inner": "beta inner",
    "gamma_outer": "gamma outer",
    "gamma_inner": "gamma inner",
    "slip_outer": "slip outer",
    "slip_inner": "slip inner",
    "size": "a",
    "pole": "p",
    "offset": "D",
    "radius_error": "epsilon",
    "offset_left": "D left",
    "offset_right": "D right",
    "radius_error_left": "epsilon left",
    "radius_error_right": "epsilon right",
}


def law_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """A row a parameter."""
    rows: list[tuple[str, ...]] = []
    for name, fit in comparison.laws.items():
        for k, (parameter, value) in enumerate(fit.values.items()):
            ends = [fit.interval95[parameter], fit.bootstrap95.get(parameter)]
            symbol = f"{SYMBOLS[parameter]} [{FAMILIES[name].parameters[parameter].unit or '-'}]"
            intervals = ["-" if pair is None else f"{pair[0]:+.5f} .. {pair[1]:+.5f}" for pair in ends]
            rows.append((name if k == 0 else "", symbol, f"{value:+.5f}", f"{fit.stderr[parameter]:.5f}", *intervals))
    return rows


def comparison_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """A row a law, by AICc."""
    rows: list[tuple[str, ...]] = []
    least = min((value for value in comparison.aicc.values() if value is not None), default=0.0)
    for name in comparison.ranking:
        fit, aicc, validation = comparison.laws[name], comparison.aicc[name], comparison.validation[name]
        lack = fit.lack_of_fit
        rows.append(
            (
                name,
                str(len(fit.values)),
                f"{fit.rms:.5f}",
                "-" if aicc is None else f"+{aicc - least:.1f}",
                _or_dash(comparison.weight[name], ".2f"),
                _or_dash(validation.radius, ".5f"),
                _or_dash(validation.speed, ".5f"),
                _or_dash(validation.yaw_rate, ".5f"),
                "-" if lack is None else f"p = {lack.probability:.2g}" + ("" if lack.significant else ", none"),
            )
        )
    return rows


def _or_dash(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)
