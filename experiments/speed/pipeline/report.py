"""The report of `trackslip reproduce`, all its figures and the page, drawn from results that are there; wall time."""

import os
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np

from experiments.measuring.check import Check
from experiments.measuring.grid import RadiusSummary, published_radii
from experiments.measuring.sightings import sightings
from experiments.parallel.early import load_drawing
from experiments.parallel.executors import helped
from experiments.report.reproduction import Report, figures_of, published_beside, render
from experiments.reproducing.figures import Figures
from experiments.speed.pipeline.reproduce import reproduce_seconds
from experiments.storage.results import RUNS_FILE
from sim.robot.robot import load_robot
from sim.stopwatch import Stopwatch
from trackslip.identification.identify import identify_samples
from trackslip.identification.samples import usable_samples
from trackslip.logs.logfile import read_runs

MOST = 2.0  # [s]


def measure(seed: int, repeats: int, step: Callable[[str], None]) -> tuple[Check, ...]:
    """Reproduce the paper, then draw its report again and again on as many processes as there are processors.

    Each time, nothing is drawn or measured before; helpers have started. Median of the rounds.
    """
    report = _results(seed)
    times = []
    for _ in range(repeats):
        with helped(0) as workers, tempfile.TemporaryDirectory() as folder:
            workers.prepare(load_drawing)
            workers.begin(os.getpid)()
            began = perf_counter()
            figures = Figures(workers, pdf=False)
            beside = workers.begin(published_beside, [log.between(0, 2) for log in report.tracking_logs])
            seen = sightings(report.grid_logs)
            figures.add(figures_of(replace(report, seen=seen, tracking_logs=())))
            whole = replace(report, seen=seen, published=beside(figures.draw_one))
            figures.add(figures_of(whole))
            render(whole, figures.drawn(Stopwatch())).write(Path(folder))
            times.append(perf_counter() - began)
        step("report")
    return (Check("report", "all figures and the page", float(np.median(times)), MOST, "s"),)


def _results(seed: int) -> Report:
    """What the report of a reproduction shows, but for its tables."""
    with tempfile.TemporaryDirectory() as folder:
        reproduce_seconds(seed, 0, Path(folder))
        logs = read_runs(Path(folder) / RUNS_FILE)
    geometry = load_robot().geometry
    grid = [log for log in logs if "radius" in log.metadata]
    found = identify_samples(usable_samples(grid, geometry, longest=True), geometry)
    commanded = tuple(dict.fromkeys(float(log.metadata["radius"]) for log in grid))
    published = published_radii(commanded)
    radius = RadiusSummary(commanded, published, published, None)  # where the points lie takes no time
    return Report(
        title="Report",
        command="trackslip reproduce",
        manifest={},
        radius=radius,
        grid_logs=grid,
        identification=found,
        tracking_logs=[log for log in logs if "controller" in log.metadata],
    )
