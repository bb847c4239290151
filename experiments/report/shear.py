"""The page of a validation of ground that shears."""

from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup

from experiments.measuring.check import Check
from experiments.report.drive_checks import CHECKS_HEADER, checks_table
from experiments.report.figures import shear as figures
from experiments.report.page import file_name
from experiments.report.template_page import Drawing, Page, render_page
from experiments.validation.shear.findings import ShearFindings

TITLE = "Ground that shears compared with theory"


def render(
    findings: Sequence[ShearFindings], checks: Sequence[Check], manifest: Mapping[str, Any], command: str
) -> Page:
    """Draw the figures of every robot, one file per panel, and fill in the template."""
    drawings: dict[str, dict[str, list[Drawing]]] = {}
    for found in findings:
        panels = {"turns": figures.offsets(found), "loads": figures.slips(found), "stops": figures.stops(found)}
        drawings[found.robot] = {
            name: [Drawing(f"{found.robot}_{file_name(one.axes[0].get_title(loc='left'))}", one) for one in several]
            for name, several in panels.items()
        }
    cards = {robot: {name: _card(several) for name, several in panels.items()} for robot, panels in drawings.items()}
    return render_page(
        "shear.html.j2",
        [one for panels in drawings.values() for several in panels.values() for one in several],
        title=TITLE,
        command=command,
        manifest=manifest,
        figures=cards,
        header=CHECKS_HEADER,
        rows=checks_table(checks),
        held=sum(check.holds for check in checks),
        count=len(checks),
    )


def _card(drawings: Sequence[Drawing]) -> Markup:
    return Markup('<div class="panels">\n{}</div>\n').format(Markup("").join(one.inline for one in drawings))
