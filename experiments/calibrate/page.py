"""The page on a calibration: its parameters, its gain, and measured and simulated motion."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from experiments.calibrate.calibration import Test, error_table, parameter_rows, remarks
from experiments.common import style
from experiments.common.colours import BLACK, BLUE, ORANGE
from experiments.common.manifest import command_line
from experiments.common.page import Answer, Page, Plot, Section
from sim.calibration.calibration import Calibration
from sim.calibration.candidate import Candidate
from sim.calibration.targets import Drives, Target
from trackslip.odometry.evaluation import from_pose


def page(
    fit: Calibration,
    base: Candidate,
    target: Target,
    test: Test | None,
    use: str,
    manifest: Mapping[str, Any],
) -> Page:
    """The page; `use` holds the options that other commands need to use the calibrated robot."""
    line = gain(fit, test)
    facts = parameter_rows(fit)
    answer = Answer(
        f"{line[0].upper()}{line[1:]}",
        facts,
        warnings=remarks(fit, test),
        next=[f"trackslip evaluate LOG {use}"],
    )
    candidates = {"before": (ORANGE, base), "calibrated": (BLUE, fit.candidate)}
    paths = partial(_paths, target, candidates) if isinstance(target, Drives) else None
    plot = Plot(
        "paths",
        paths,
        "Measured and simulated paths",
        "In windows of the log, from the first pose on.",
    )
    sections = [Section("Errors", [error_table(fit, test), plot])]
    made = command_line("calibrate")
    return Page("Calibration of the simulated robot", made, manifest, sections, answer=answer)


def gain(fit: Calibration, test: Test | None) -> str:
    """The error before and after the fit: on another log, on the held-out part, or on the fitted
    data.
    """
    table = error_table(fit, test)
    row = table.texts[0]
    for other in table.texts:
        if other[0].startswith("position") and other[0].endswith("median"):
            row = other  # the last of them, which is the farthest ahead
    return f"{row[0]}: {row[-1]} ({table.header[-1]}), {row[-2]} before"


@style.styled
def _paths(target: Drives, candidates: Mapping[str, tuple[str, Candidate]]) -> style.Panels:
    """Measured and simulated paths in up to four windows of a log; `candidates` has a colour and a
    robot per label.
    """
    count = min(4, len(target.windows))
    chosen = np.linspace(0, len(target.windows) - 1, count).astype(int)
    figures = []
    for k in chosen:
        log = target.windows[k]
        figure, axis = style.panel(f"Window {k + 1}: {log.run}", "", "", 3.4)
        seen = log.has_heading
        axis.plot(*log.pose[seen, :2].T, ".", color=BLACK, ms=4, label="measured")
        for label, (colour, candidate) in candidates.items() if seen.any() else ():
            time = log.time[seen] + candidate.clock
            path = target.motion(candidate).sensor_at(k, candidate.sensor, time)
            placed = from_pose(path, log.pose[seen])
            axis.plot(placed[:, 0], placed[:, 1], color=colour, label=label)
        style.plane(axis, adjustable="datalim")
        style.legend_below(figure, axis.lines)
        figures.append(figure)
    return tuple(figures)
