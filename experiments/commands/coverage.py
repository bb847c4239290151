"""`trackslip coverage`: do the 95 % intervals hold the truth in 95 % of many repeats?"""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from experiments.commands.identify import SYMBOLS
from experiments.driving.grid_runs import drive_grid
from experiments.driving.world import World
from experiments.options.coverage import CoverageConfig
from experiments.parallel.workers import deaf_children, processes
from experiments.recording import record_all
from experiments.report.terminal import print_table, progress
from experiments.storage.plain_json import plain, write_json
from experiments.storage.results import MANIFEST_FILE, SUMMARY_FILE, results_folder
from sim.seeds import generator
from trackslip.identification.comparison import Comparison, compare_laws
from trackslip.identification.coverage import coverage, noise_coverage
from trackslip.identification.fitted import fit_law
from trackslip.identification.samples import SlipSamples, true_samples
from trackslip.kinematics import RobotGeometry
from trackslip.logs.runlog import RunLog
from trackslip.motion.methods import MOTION_METHODS
from trackslip.motion.steady import steady_part
from trackslip.slip.families import FAMILIES

_MOTION = "bundle"
"""The method whose errors are drawn: the one that takes ranges, to which noise can be added again and again."""
_RUN_LAW = "icr_radius"
"""The law that is fitted to runs scanned anew."""


def run(config: CoverageConfig) -> None:
    """Drive grids without noise, then repeat what is random."""
    began = time.perf_counter()
    with results_folder(config.out) as folder:
        world = World.of(config.grid(0))
        geometry = world.robot.geometry
        repeats: list[tuple[SlipSamples, SlipSamples]] = []
        for k, count in enumerate(config.shares()):
            logs = drive_grid(config.grid(k), world)
            if k == 0 and config.rrd:
                record_all(folder, logs)
            truth = true_samples(logs, geometry, of_plate=True)
            repeats += [(samples, truth) for samples in scanned_again(logs, geometry, config, count)]
        design = repeats[0][0]
        fitted = compare_laws(design, geometry)
        told, untold = drawn_coverage(config, design, fitted, geometry)
        summary: dict[str, Any] = {"repeats": config.repeats, "laws": told, "laws_errors_unknown": untold}
        noise, everything = noise_coverage(_RUN_LAW, repeats, geometry)
        lean = bias_by_lean(design, truth, true_samples(logs, geometry), geometry)
        summary["runs"] = {
            "repeats": len(repeats),
            "law": _RUN_LAW,
            "noise": noise,
            "interval95": everything,
            "bias_by_lean": lean,
        }
        wall = time.perf_counter() - began
        summary["timing"] = {"wall_s": wall, "stages": {"coverage": wall}}
        write_json(folder / SUMMARY_FILE, summary)
        write_json(folder / MANIFEST_FILE, world.manifest("coverage", wall) | {"config": plain(config)})
    print_table(
        f"Share of {config.repeats} repeats whose 95 % interval holds the parameter",
        ("law", "parameter", "drawn from", "errors given", "errors unknown"),
        coverage_rows(summary, fitted),
    )
    print_table(
        f"Share of {len(repeats)} grids whose fit of {_RUN_LAW} holds the fit to the true motion",
        ("parameter", "noise alone", "95 % interval"),
        [(SYMBOLS[key], f"{noise[key]:.3f}", f"{everything[key]:.3f}") for key in noise],
    )
    print(
        "The true motion here is the plate's, which leans outwards with the robot; it changes "
        + " and ".join(f"{SYMBOLS[key]} by {value:+.6f}" for key, value in lean.items())
    )
    print(f"{config.out / SUMMARY_FILE}: {wall:.1f} s")


def drawn_coverage(
    config: CoverageConfig, design: SlipSamples, fitted: Comparison, geometry: RobotGeometry
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Shares for samples drawn from every law, with errors of measurement that the fits are told, and are not."""
    names = [name for name in FAMILIES if FAMILIES[name].names]
    shares: dict[bool, dict[str, Any]] = {True: {}, False: {}}
    with progress(f"{len(names)} laws, {config.repeats} sets of samples each", 2 * len(names), "fits") as report:
        for name, known in itertools.product(names, (True, False)):
            rng = generator(config.seed, f"coverage {name} {known}")
            values = generating_values(name, fitted)
            shares[known][name] = coverage(name, values, design, geometry, config.repeats, rng, known)
            report(1.0)
    return shares[True], shares[False]


def generating_values(name: str, fitted: Comparison) -> Mapping[str, float]:
    """Parameters to draw with: those of the grid; for a law with sides, which left turns don't tell, the ICR's."""
    if name in fitted.laws:
        return fitted.laws[name].values
    both = fitted.laws["icr_radius"].values
    return {key: both[key.rsplit("_", 1)[0]] for key in FAMILIES[name].names}


def bias_by_lean(
    design: SlipSamples, plate: SlipSamples, robot: SlipSamples, geometry: RobotGeometry
) -> dict[str, float]:
    """How much larger each parameter is when the law is fitted to the plate's true motion instead of the robot's."""
    fits = [
        fit_law(_RUN_LAW, replace(design, twist=true.twist, slip=true.slip), geometry, bootstraps=0).values
        for true in (plate, robot)
    ]
    return {key: fits[0][key] - fits[1][key] for key in fits[0]}


def scanned_again(
    logs: list[RunLog], geometry: RobotGeometry, config: CoverageConfig, repeats: int
) -> list[SlipSamples]:
    """Samples of runs whose true ranges get new noise every time; the runs are shared out over processes."""
    jobs = [(log, geometry, config.scanner.noise, config.seed, repeats) for log in logs]
    omega = np.array([log.omega[steady_part(log, geometry).rows].mean(axis=0) for log in logs])
    found = []
    with (
        processes(config.threads or os.cpu_count() or 1) as pool,
        progress(f"{len(logs)} runs scanned {repeats} times", len(logs), "runs") as report,
    ):
        with deaf_children():
            results = pool.map(_bundled, jobs)
        for twist, covariance in results:
            found.append((twist, covariance))
            report(1.0)
    names = [log.run for log in logs]
    return [
        SlipSamples.of(
            omega,
            np.array([twist[k] for twist, _ in found]),
            geometry,
            names,
            np.array([covariance[k] for _, covariance in found]),
        )
        for k in range(repeats)
    ]


def _bundled(job: tuple[RunLog, RobotGeometry, float, int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Twists (repeats, 2) and covariances (repeats, 2, 2) of one run, with noise of its own each time."""
    log, geometry, noise, seed, repeats = job
    assert log.scans is not None
    rng = generator(seed, f"coverage {log.run}")
    part = steady_part(log, geometry)
    cluster = log.scans.cluster
    found = []
    for _ in range(repeats):
        ranges = np.where(cluster.hit, cluster.range + rng.normal(0.0, noise, cluster.range.shape), 1.0)
        scans = replace(log.scans, scan=replace(log.scans.scan, noise=noise), cluster=replace(cluster, range=ranges))
        found.append(MOTION_METHODS[_MOTION](replace(part.log, scans=scans), part.window))
    return np.array([one.twist for one in found]), np.array([one.covariance for one in found])


def coverage_rows(summary: Mapping[str, Any], fitted: Comparison) -> list[tuple[str, ...]]:
    """A row a parameter."""
    rows: list[tuple[str, ...]] = []
    for name, told in summary["laws"].items():
        values = generating_values(name, fitted)
        for k, (key, share) in enumerate(told.items()):
            unit = FAMILIES[name].parameters[key].unit or "-"
            unknown = summary["laws_errors_unknown"][name][key]
            symbol = f"{SYMBOLS[key]} [{unit}]"
            rows.append((name if k == 0 else "", symbol, f"{values[key]:+.4f}", f"{share:.3f}", f"{unknown:.3f}"))
    return rows
