"""`trackslip reproduce`: the paper from its first run to its last figure."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.commands.track import (
    TRACKING_HEADER,
    tracking_rows,
    tracking_summary,
)
from experiments.driving.grid_runs import (
    drive_grid,
    grid_summary,
    make_locator,
    saturation_warnings,
    simulated_seconds,
    stages_text,
)
from experiments.driving.lookup import KNOWN_LAWS
from experiments.driving.world import World
from experiments.options.reproduce import ReproduceConfig
from experiments.options.world import IDENTIFIED, LINEAR_START
from experiments.recording import record_all
from experiments.report.reproduction import ComparisonRow, Report, render
from experiments.report.terminal import print_table, progress
from experiments.storage.manifest import command_line
from experiments.storage.plain_json import plain
from experiments.storage.results import REPORT_FILE, results_folder, write_results
from sim.run_recorder import Description
from sim.runs import Pilot, closed_loop
from sim.seeds import generator
from sim.stopwatch import Stopwatch
from trackslip.controllers.named import CONTROLLERS
from trackslip.identification.identify import identify_samples
from trackslip.identification.samples import usable_samples
from trackslip.identification.summary import identification_to_json
from trackslip.logs.runlog import RunLog
from trackslip.slip.base import SlipLaw
from trackslip.slip.compensation import FixedLaw
from trackslip.slip.exponential import PUBLISHED
from trackslip.trajectory.segmented import paper_reference


def run(config: ReproduceConfig) -> None:
    """Grid, identification, verification, report, in this order."""
    began = time.perf_counter()
    watch = Stopwatch()
    with results_folder(config.out) as folder:
        world = World.of(config)
        robot = world.robot
        grid_logs = drive_grid(config, world, watch)
        with watch.stage("slips"):
            sampling = usable_samples(grid_logs, robot.geometry, method=config.motion)
        with watch.stage("laws"):
            found = identify_samples(sampling, robot.geometry)
        with watch.stage("errors of all methods"):
            warnings = [*saturation_warnings(grid_logs), *found.warnings]
            laws = found.comparison.laws
            summary = identification_to_json(found) | {
                "published": published_summary(),
                "warnings": warnings,
            }
            names = [log.run for log in grid_logs]
            summary |= grid_summary(config, names, grid_logs, sampling.samples, robot.geometry, watch)
        with watch.stage("closed loops"):
            tracking_logs = drive_paths(config, world, {name: laws[name].law for name in IDENTIFIED if name in laws})
            summary["tracking"] = tracking_summary(tracking_logs, paper_reference())
        summary = plain(summary)
        rows = comparison(summary)
        with watch.stage("report"):
            about = world.manifest("reproduce", time.perf_counter() - began)
            page = Report(
                title="Slip of a tracked robot: the paper and its simulation",
                command=command_line("reproduce"),
                manifest=about,
                summary=summary,
                comparison=rows,
                grid_logs=grid_logs,
                identification=found,
                tracking_logs=tracking_logs,
            )
            render(page).write(folder, config.pdf)
        wall = time.perf_counter() - began
        summary["timing"] = {
            "wall_s": wall,
            "simulated_s": simulated_seconds([*grid_logs, *tracking_logs]),
            "stages": watch.stages,
        }
        write_results(folder, [*grid_logs, *tracking_logs], summary, about)
        if config.rrd:
            record_all(folder, [*grid_logs, *tracking_logs], _by_controller(tracking_logs))
    print_table(
        "Published | simulated",
        ("quantity", "published", "simulated"),
        [(row.quantity, row.published, row.simulated) for row in rows],
    )
    print_table("Tracking errors of the true pose", TRACKING_HEADER, tracking_rows(summary["tracking"]))
    for warning in warnings:
        print(f"warning: {warning}")
    print(stages_text(watch.stages))
    simulated = summary["timing"]["simulated_s"]
    print(f"{config.out / REPORT_FILE}: {wall:.1f} s for {simulated:.0f} s of simulated driving")


def drive_paths(config: ReproduceConfig, world: World, identified: Mapping[str, SlipLaw]) -> list[RunLog]:
    """Both controllers with every compensation on the paper's path, as one fleet; Sec. IV."""
    reference = paper_reference()
    starts = {"feedforward": reference.pose(0.0), "linear": np.array(LINEAR_START)}
    laws = {**KNOWN_LAWS, **identified}
    cases = [(controller, compensation) for controller in starts for compensation in laws]
    keys = [f"{controller} {compensation}" for controller, compensation in cases]
    fleet = world.fleet(np.array([starts[controller] for controller, _ in cases]))
    feed = world.feed(fleet, [generator(config.seed, f"track {key}") for key in keys])
    pilots = [
        Pilot(CONTROLLERS[controller](), [k], FixedLaw(laws[compensation]))
        for k, (controller, compensation) in enumerate(cases)
    ]
    common = world.metadata(config.localization) | {"reference": "paper"}
    descriptions = [
        Description(key, {"controller": controller, "compensation": compensation, **common})
        for key, (controller, compensation) in zip(keys, cases, strict=True)
    ]
    with progress(f"{len(cases)} closed loops", reference.duration) as bar:
        return closed_loop(
            fleet, pilots, reference, feed, make_locator(config.localization, world.robot), descriptions, bar
        )


def _by_controller(logs: Sequence[RunLog]) -> dict[str, list[RunLog]]:
    """Runs to compare: those that differ in their compensation only."""
    controllers = dict.fromkeys(log.metadata["controller"] for log in logs)
    return {f"{name} compared": [log for log in logs if log.metadata["controller"] == name] for name in controllers}


def published_summary() -> dict[str, Any]:
    """Eq. 11 as it stands in a summary."""
    return {
        "outer": {"alpha": PUBLISHED.alpha_outer, "beta": PUBLISHED.beta_outer},
        "inner": {"alpha": PUBLISHED.alpha_inner, "beta": PUBLISHED.beta_inner},
    }


def comparison(summary: Mapping[str, Any]) -> list[ComparisonRow]:
    """The table published | simulated, from a summary."""
    values = {name: law["values"] for name, law in summary["slip_laws"].items()}
    exponential, icr, radius = values.get("exponential"), values.get("icr_radius"), summary["radius"]
    spread, error, found = summary["speed_spread"], summary["slip_error"], summary["localization"]
    row = ComparisonRow
    rows = [
        row(
            f"slip law, {track} track",
            _exponential(summary["published"][track]["alpha"], summary["published"][track]["beta"]),
            _exponential(exponential[f"alpha_{track}"], exponential[f"beta_{track}"]) if exponential else "-",
        )
        for track in ("outer", "inner")
    ]
    for commanded, observed, published in zip(
        *(radius[key] for key in ("commanded", "observed", "published")), strict=True
    ):
        printed = "-" if published is None else f"{published:.2f} m"
        driven = "-" if observed is None else f"{observed:.2f} m"
        rows.append(row(f"radius driven, {commanded:g} m commanded", printed, driven))
    rows += [
        row("radius error, rms", "-", _percent(radius["rms_vs_published"])),
        row("slip minus Eq. 11, rms", "-", _number(summary["slip_rms_vs_published"])),
        row("  at the simulation's own radii", "-", _number(summary["slip_rms_vs_published_at_simulated_radii"])),
        row(
            "spread over speeds, outer | inner",
            "almost none",
            f"{_number(spread['outer'])} | {_number(spread['inner'])}",
        ),
        row("offset of the ICRs, D", "-", f"{1e3 * icr['offset']:.2f} mm" if icr else "-"),
        row("error of the effective radius", "-", _percent(icr["radius_error"] if icr else None)),
        row("localisation, rms x | y", "-", f"{1e3 * found['rmse_x']:.1f} | {1e3 * found['rmse_y']:.1f} mm"),
        row("localisation, rms heading", "-", f"{np.degrees(found['rmse_heading']):.2f} deg"),
        row("valid poses per second", "at least 10", f"{found['rate_hz']:.1f}"),
        row("slip error std, outer | inner", "-", _pair(error, "std")),
        row("slip error bias, outer | inner", "-", _pair(error, "bias")),
    ]
    for controller, key, what, seen in (
        ("feedforward", "final_position", "feedforward, final", "much better, Fig. 8"),
        ("linear", "rms_position_after_12s", "Eq. 31 after 12 s", "better, Fig. 11"),
    ):
        for entry in summary["tracking"]:
            if entry["controller"] == controller:
                printed = seen if entry["compensation"] == "published" else "-"
                rows.append(row(f"{what}, {entry['compensation']}", printed, f"{1e3 * entry[key]:.1f} mm"))
    return rows


def _exponential(alpha: float, beta: float) -> str:
    return f"{alpha:.3g} exp({beta:.2f} R)"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.2f} %"


def _pair(error: Mapping[str, Mapping[str, float]], key: str) -> str:
    return f"{error['outer'][key]:.5f} | {error['inner'][key]:.5f}"
