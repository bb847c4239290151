"""The page of a calibration: its parameters, its gain, and measured against simulated motion."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.calibrate.calibration import Test, error_table, parameter_table, remarks
from experiments.common import style
from experiments.common.colours import BLACK, BLUE, ORANGE
from experiments.common.page import Answer, Page, Plot, Section
from sim.calibration.calibration import Calibration
from sim.calibration.candidate import Candidate
from sim.calibration.targets import SLIP_SCALE, Drives, SteadyRows, Target, TurnTable
from trackslip.kinematics import Array
from trackslip.odometry.trajectory_errors import from_pose

_METHOD = (
    "Parameters are fitted by a robust Gauss-Newton method with a normal prior around each initial value. Intervals "
    "are those of independent parts of the target; a parameter that it doesn't tell is held at its initial value."
)
_LOOKS = ("before", ORANGE, "^"), ("calibrated", BLUE, "o")
_WINDOWS = 4  # drawn
_WIDTH = 4.6  # of a panel, about a phone's [in]


def page(
    fit: Calibration,
    base: Candidate,
    target: Target,
    test: Test | None,
    use: str,
    manifest: Mapping[str, Any],
    made: str,
) -> Page:
    """The page; `use` are the options by which commands take the robot, `made` is the command line."""
    errors, parameters = error_table(fit, test), parameter_table("Parameters", fit)
    facts = [(name, f"{value} ({interval})") for name, value, interval in parameters.texts]
    line = gain(fit, test)
    answer = Answer(
        f"{line[0].upper()}{line[1:]}", facts, warnings=remarks(fit, test), next=[f"trackslip evaluate LOG {use}"]
    )
    plot = Plot(
        "measured_and_simulated",
        partial(drawn, target, {"before": base, "calibrated": fit.candidate}),
        "Measured against simulated",
        "Measured paths (dots) and those of the simulated robot, in windows of the log."
        if isinstance(target, Drives)
        else "On the line, the simulated robot moves as measured.",
    )
    sections = [Section("Errors", [plot, errors]), Section("Method", [_METHOD, parameters], folded=True)]
    return Page("Calibration of the simulated robot", made, manifest, sections, answer=answer)


def gain(fit: Calibration, test: Test | None) -> str:
    """The error before and after: on another log, on what was held out, or as fitted."""
    table = error_table(fit, test)
    ahead = [row for row in table.texts if row[0].startswith("position") and row[0].endswith("median")]
    row = (ahead or table.texts)[-1 if ahead else 0]
    return f"{row[0]}: {row[-1]} ({table.header[-1]}), {row[-2]} before"


@style.styled
def drawn(target: Target, candidates: Mapping[str, Candidate]) -> style.Panels:
    """Paths in windows of drives; of other targets, numbers over numbers."""
    if isinstance(target, Drives):
        return _paths(target, candidates)
    figures, numbers = [], {label: _numbers(target, candidates[label]) for label, _, _ in _LOOKS}
    for k in range(2):
        figure = Figure(figsize=(_WIDTH, 4.2), layout="constrained")
        axis = figure.subplots()
        for label, colour, marker in _LOOKS:
            name, measured, simulated = numbers[label][k]
            axis.plot(measured, simulated, marker, label=label, ms=3.5, mfc="none", color=colour)
        axis.set(title=name, xlabel="measured", ylabel="simulated")
        axis.axline((axis.get_xlim()[0],) * 2, slope=1, **style.THEORY)
        figure.legend(handles=axis.lines[:2], loc="outside lower center", ncols=2)
        figures.append(figure)
    return tuple(figures)


def _numbers(target: Target, candidate: Candidate) -> Sequence[tuple[str, Array, Array]]:
    """Names, measured and simulated numbers."""
    if isinstance(target, SteadyRows):
        pairs = zip(("v [m/s]", "w [rad/s]"), target.samples.twist.T, target.predicted(candidate), strict=False)
        return list(pairs)
    assert isinstance(target, TurnTable)
    slip = target.slip + SLIP_SCALE * target.errors(candidate)[: target.slip.size].reshape(-1, 2)
    names = "slip of the inner track", "slip of the outer track"
    return list(zip(names, target.slip.T, slip.T, strict=True))


def _paths(target: Drives, candidates: Mapping[str, Candidate]) -> style.Panels:
    figures, looks = [], [(label, colour, candidates[label]) for label, colour, _ in _LOOKS]
    for k in np.linspace(0, len(target.windows) - 1, min(_WINDOWS, len(target.windows))).astype(int):
        figure = Figure(figsize=(_WIDTH, 3.4), layout="constrained")
        axis, log = figure.subplots(), target.windows[k]
        seen = log.has_heading
        axis.plot(*log.pose[seen, :2].T, ".", color=BLACK, ms=4, label="measured")
        for label, colour, one in looks if seen.any() else ():
            path = target.motion(one).sensor_at(k, one.sensor, log.time[seen] + one.clock)
            axis.plot(*from_pose(path, log.pose[seen])[:, :2].T, color=colour, label=label)
        style.plane(axis, adjustable="datalim", title=f"Window {k + 1}: {log.run}")
        figure.legend(handles=axis.lines, loc="outside lower center", ncols=3)
        figures.append(figure)
    return tuple(figures)
