"""Fig. 9: what the errors of Eq. 18 are, computed for a robot and a desired pose and drawn."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc

from experiments.report.figures.style import BLACK, BLUE, GREEN, GREY, ORANGE, styled
from trackslip.kinematics import Array
from trackslip.metrics import body_errors

_ROBOT = np.array([0.2, 0.15, np.radians(20)])
_DESIRED = np.array([1.5, 1.2, np.radians(55)])


@styled
def errors_defined() -> Figure:
    """The robot, where it should be, and the errors between them in the robot's frame."""
    e_x, e_y, e_phi = body_errors(_ROBOT, _DESIRED)
    forward, left = np.array([np.cos(_ROBOT[2]), np.sin(_ROBOT[2])]), np.array([-np.sin(_ROBOT[2]), np.cos(_ROBOT[2])])
    corner = _ROBOT[:2] + e_x * forward
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    axis = figure.subplots()
    _robot(axis, _ROBOT, BLACK, "robot (x, y, φ)")
    _robot(axis, _DESIRED, GREY, "desired (x$_d$, y$_d$, φ$_d$)")
    axis.plot(*np.transpose([_ROBOT[:2], corner]), color=BLUE, lw=2.2)
    axis.plot(*np.transpose([corner, corner + e_y * left]), color=ORANGE, lw=2.2, ls="--")
    axis.annotate("e$_x$, forward", (_ROBOT[:2] + corner) / 2, xytext=(8, -14), textcoords="offset points", color=BLUE)
    axis.annotate("e$_y$, to the left", corner + e_y / 2 * left, xytext=(8, -4), textcoords="offset points")
    ahead = _DESIRED[:2] + 0.7 * forward
    axis.plot(*np.transpose([_DESIRED[:2], ahead]), color=GREY, lw=1.0, ls=":")
    angles = np.degrees([_ROBOT[2], _ROBOT[2] + e_phi])
    axis.add_patch(Arc(tuple(_DESIRED[:2]), 1.0, 1.0, theta1=angles[0], theta2=angles[1], color=GREEN, lw=2.2))
    middle = _DESIRED[:2] + 0.56 * np.array([np.cos(np.radians(angles.mean())), np.sin(np.radians(angles.mean()))])
    axis.annotate("e$_φ$", (middle[0], middle[1]), color=GREEN, va="center")
    axis.set_aspect("equal")
    axis.set(xlabel="x [m]", ylabel="y [m]", xlim=(-1.2, 3.0), ylim=(-0.3, 1.9))
    return figure


def _robot(axis: Axes, pose: Array, colour: str, label: str) -> None:
    """A body with an arrow forwards."""
    x, y, phi = pose
    turn = np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]])
    corners = np.array([[0.2, 0.17], [-0.2, 0.17], [-0.2, -0.17], [0.2, -0.17], [0.2, 0.17]]) @ turn.T
    axis.plot(x + corners[:, 0], y + corners[:, 1], color=colour, lw=1.5)
    tip = pose[:2] + 0.38 * turn[:, 0]
    axis.annotate("", (tip[0], tip[1]), (x, y), arrowprops={"arrowstyle": "->", "color": colour, "lw": 1.5})
    axis.annotate(label, (x, y), xytext=(-44, 0), textcoords="offset points", ha="right", va="center")
