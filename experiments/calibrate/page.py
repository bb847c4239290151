"""The page on a calibration: its parameters, its gain, and measured and simulated motion."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from experiments.calibrate.calibration import Test, error_table, parameter_rows, remarks
from experiments.common.chart import Chart, Curve, dots
from experiments.common.colours import BLACK, BLUE, GREY, ORANGE
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
    following: str,
    manifest: Mapping[str, Any],
) -> Page:
    """The page; `following` is a command that uses the calibrated robot or soil."""
    line = gain(fit, test)
    facts = parameter_rows(fit)
    answer = Answer(
        f"{line[0].upper()}{line[1:]}",
        facts,
        warnings=remarks(fit, test),
        next=[following],
    )
    candidates = {"before": (ORANGE, base), "calibrated": (BLUE, fit.candidate)}
    paths = partial(_paths, target, candidates) if isinstance(target, Drives) else None
    plots = [
        Plot(
            "measured_and_simulated",
            partial(comparison_charts, target, candidates),
            "Measured and simulated",
            "Simulated over measured values: on the grey line, they are the same.",
        ),
        Plot(
            "paths",
            paths,
            "Measured and simulated paths",
            "In windows of the log, from the first pose on.",
        ),
    ]
    sections = [Section("Measured and simulated", [*plots, error_table(fit, test)])]
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


def comparison_charts(
    target: Target, candidates: Mapping[str, tuple[str, Candidate]]
) -> list[Chart]:
    """Simulated over measured values, a chart per quantity; `candidates` has a colour and a robot
    per label.
    """
    curves: dict[str, list[Curve]] = {}
    for (label, (colour, candidate)), marker in zip(candidates.items(), "os", strict=True):
        for each in target.compared(target.errors(candidate)):
            name = f"{each.name} [{each.unit}]"
            line = Curve(each.measured, each.simulated, label, colour, 0.0, "-", marker, 4.0)
            curves.setdefault(name, []).append(line)
    charts = []
    for name, lines in curves.items():
        values = np.concatenate([values for line in lines for values in (line.x, line.y)])
        known = values[np.isfinite(values)]
        if not known.size:
            continue
        ends = np.array([known.min(), known.max()])
        same = Curve(ends, ends, "equal", GREY, 1.0)
        title, _, _ = name.partition(" [")
        title = title[0].upper() + title[1:]
        charts.append(Chart(title, f"measured {name}", f"simulated {name}", [same, *lines]))
    return charts


def _paths(target: Drives, candidates: Mapping[str, tuple[str, Candidate]]) -> list[Chart]:
    """Measured and simulated paths in up to four windows of a log; `candidates` has a colour and a
    robot per label.
    """
    count = min(4, len(target.windows))
    chosen = np.linspace(0, len(target.windows) - 1, count).astype(int)
    charts = []
    for k in chosen:
        log = target.windows[k]
        seen = log.has_heading
        curves = [dots(log.pose[seen], "measured", BLACK, 3.0)]
        for label, (colour, candidate) in candidates.items() if seen.any() else ():
            time = log.time[seen] + candidate.clock
            path = target.motion(candidate).sensor_at(k, candidate.sensor, time)
            placed = from_pose(path, log.pose[seen])
            curves.append(Curve(placed[:, 0], placed[:, 1], label, colour))
        title = f"Window {k + 1}: {log.run}"
        charts.append(Chart(title, "x [m]", "y [m]", curves, 3.6, is_map=True))
    return charts
