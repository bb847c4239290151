"""`trackslip sensitivity`: what each error of the scanner, its mounting and its field does to slip."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from experiments.driving.grid_runs import drive_grid, localization_summary
from experiments.driving.world import World
from experiments.measuring.disturbances import EFFECTS, Effect
from experiments.options.sensitivity import SensitivityConfig
from experiments.recording import record_all
from experiments.report.sensitivity import render
from experiments.report.terminal import print_table
from experiments.storage.manifest import command_line
from experiments.storage.plain_json import write_json
from experiments.storage.results import MANIFEST_FILE, REPORT_FILE, SUMMARY_FILE, results_folder
from trackslip.errors import LogError
from trackslip.identification.samples import true_samples, usable_samples
from trackslip.kinematics import Array, RobotGeometry
from trackslip.logs.runlog import RunLog

_TRACKS = {"outer": 1, "inner": 0}  # the runs turn left
_HEADER = (
    "",
    *(name for track in _TRACKS for name in (f"{track} bias", "std", "largest")),
    *("x [mm]", "y [mm]", "phi [deg]", "valid", "runs"),
)


def run(config: SensitivityConfig) -> None:
    """Drive, evaluate, store and print."""
    began = time.perf_counter()
    with results_folder(config.out) as folder:
        world = World.of(config)
        shown: list[RunLog] | None = [] if config.rrd else None
        rows = measure(config, world, shown)
        wall = time.perf_counter() - began
        table = [as_text(row) for row in rows]
        about = world.manifest("sensitivity", wall)
        page = render(rows, _HEADER, table, about, command_line("sensitivity"))
        page.write(folder, config.pdf)
        write_json(folder / SUMMARY_FILE, {"rows": rows, "timing": {"wall_s": wall}})
        write_json(folder / MANIFEST_FILE, about)
        record_all(folder, shown or [])
    print_table("Errors of slip over the runs, and of the poses (rms)", _HEADER, table)
    for row in rows:
        if row["slip_error"] is None:
            print(f"warning: {row['effect']}: {row['warnings'][-1]}")
    print(f"{config.out / REPORT_FILE}: {len(rows)} grids in {wall:.1f} s")


def measure(config: SensitivityConfig, world: World, shown: list[RunLog] | None = None) -> list[dict[str, Any]]:
    """A row for each of EFFECTS, all with the same random numbers; the first run of each is added to `shown`."""
    nominal = drive_grid(config, world)
    rows = []
    for effect in EFFECTS:
        changed = effect.driven(config)
        logs = nominal if changed == config else drive_grid(changed, World.of(changed))
        logs = [effect.evaluated(log) for log in logs]
        if shown is not None:
            shown.append(replace(logs[0], run=f"{effect.name}, {logs[0].run}"))
        rows.append({"effect": effect.name, "settings": settings(effect)} | errors(logs, world, config.motion))
    return rows


def settings(effect: Effect) -> dict[str, Any]:
    """What differs from the nominal experiment."""
    rest = {"obstacles": effect.obstacles, "plate_left": effect.plate_left, "clock": effect.clock}
    return dict(effect.scanner) | {name: value for name, value in rest.items() if value}


def errors(logs: Sequence[RunLog], world: World, motion: str | None) -> dict[str, Any]:
    """Errors of slip over the runs that can be used, None where none can; errors of all poses; and why not."""
    geometry = world.robot.geometry
    slip, warnings = slip_errors(logs, geometry, motion)
    return {
        "slip_error": None if slip is None else {name: statistics(slip[:, k]) for name, k in _TRACKS.items()},
        "localization": localization_summary(logs),
        "runs": {"used": 0 if slip is None else len(slip), "all": len(logs)},
        "warnings": warnings,
    }


def slip_errors(logs: Sequence[RunLog], geometry: RobotGeometry, motion: str | None) -> tuple[Array | None, list[str]]:
    """Errors (n, 2) of slip in the runs that can be used, None where none can; and why the others can't."""
    try:
        sampling = usable_samples(logs, geometry, method=motion)
    except LogError as error:
        return None, [str(error)]
    truth = true_samples([log for log in logs if log.run in sampling.samples.run], geometry)
    return sampling.samples.slip - truth.slip, [*sampling.notes, *map(str, sampling.refused)]


def statistics(error: Array) -> dict[str, float]:
    """Of errors (n,) over the runs."""
    return {"bias": error.mean(), "std": error.std(), "largest": np.abs(error).max()}


def as_text(row: dict[str, Any]) -> tuple[str, ...]:
    """A row of the table."""
    slip, where, runs = row["slip_error"], row["localization"], row["runs"]
    numbers = ["-"] * 6
    if slip is not None:
        numbers = [
            text
            for track in _TRACKS
            for text in (
                f"{slip[track]['bias']:+.5f}",
                f"{slip[track]['std']:.5f}",
                f"{slip[track]['largest']:.5f}",
            )
        ]
    return (
        row["effect"],
        *numbers,
        f"{1e3 * where['rmse_x']:.1f}",
        f"{1e3 * where['rmse_y']:.1f}",
        f"{np.degrees(where['rmse_heading']):.2f}",
        f"{where['valid_fraction']:.1%}",
        f"{runs['used']}/{runs['all']}",
    )
