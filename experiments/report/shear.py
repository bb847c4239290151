"""The page of a validation of ground that shears."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from experiments.measuring.check import Check
from experiments.report.checks import checks_table
from experiments.report.figures import shear as figures
from experiments.report.page import Bullets, Page, Plot, Section
from experiments.validation.shear.findings import ShearFindings

TITLE = "Ground that shears compared with theory"


def page(findings: Sequence[ShearFindings], checks: Sequence[Check], manifest: Mapping[str, Any], command: str) -> Page:
    """The checks, and the figures of every robot."""
    held = f"{sum(check.holds for check in checks)} of {len(checks)} checks hold. Errors are the largest of their kind."
    return Page(
        TITLE,
        command,
        manifest,
        [
            Section("In numbers", [held, checks_table(TITLE, checks)]),
            *(Section(f"Robot: {found.robot}", _plots(found)) for found in findings),
            Section("What this does not show", [_LIMITS]),
        ],
        intro=[
            "Ground that shears gives way before it slides: an element of track that has moved by j over the ground "
            "since it touched down is held by the share 1 − exp(−j / K) of the friction. This page compares the "
            "simulator with the quasi-static balance of the same forces, for shear moduli K from 2 to 25 mm."
        ],
    )


def _plots(found: ShearFindings) -> tuple[Plot, ...]:
    return (
        Plot(
            f"{found.robot}_turns",
            partial(figures.offsets, found),
            "Turns",
            "D, by which the tracks' ICRs lie farther out than the tracks; lines are theory. On Coulomb ground it is "
            "the same for all radii. On ground that shears it falls with the radius: the outer parts of a track's "
            "contact slide far enough to be held in full only in tight turns.",
            "",
        ),
        Plot(
            f"{found.robot}_loads",
            partial(figures.slips, found),
            "Load",
            "Slip straight uphill, and straight ahead with a drawbar; lines are theory.",
            "",
        ),
        Plot(
            f"{found.robot}_stops",
            partial(figures.stops, found),
            "Stop and go",
            "Dotted: how far the robot lags behind its belts on a slope, with stops. Lines: the steady slip of the "
            "belts' way, which knows no inertia.",
            "",
        ),
    )


_LIMITS = Bullets(
    [
        "That real ground shears like this. It also sinks, piles up beside the tracks and remembers earlier passes.",
        "Motion that changes faster than an element of track passes through the contact; theory is for steady motion.",
    ]
)
