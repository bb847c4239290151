"""Quasi-static motion of a tracked robot: the theory with which the simulator is compared.

The ground's force on a sliding element of track opposes its sliding velocity s, within an elliptic
friction limit:

    F = -g N (mu_along^2 s_x, mu_across^2 s_y) / sqrt((mu_along s_x)^2 + (mu_across s_y)^2)

On Coulomb ground g = 1; on ground that shears, g = 1 - exp(-|j| / K) grows with the displacement j
of the element over the ground since it entered the contact. In slow steady motion these forces
balance the load. The theory follows Moreau's principle of maximum dissipation, Janosi and Hanamoto
(1961), and Wong and Chiang (2001). `soil` adds sinkage and its resistance, after Bekker (1969).
"""

from trackslip.skid_theory.contact import Contact, Load, line_contact, wheel_contact
from trackslip.skid_theory.soil import (
    DrawbarCurve,
    Soil,
    Tracks,
    Wheels,
    drawbar_curve,
    most_slope,
    roll,
    slip_for,
)
from trackslip.skid_theory.steady import SteadyTurns, steady_turns, steady_twist

__all__ = [
    "Contact",
    "DrawbarCurve",
    "Load",
    "Soil",
    "SteadyTurns",
    "Tracks",
    "Wheels",
    "drawbar_curve",
    "line_contact",
    "most_slope",
    "roll",
    "slip_for",
    "steady_turns",
    "steady_twist",
    "wheel_contact",
]
