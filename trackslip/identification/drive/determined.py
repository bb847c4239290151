"""What the driving determines: combinations of parameters that it leaves open, and words for them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackslip.identification.drive.fit import Fit
from trackslip.identification.drive.model import EXTRAS
from trackslip.kinematics import Array

_VAGUE = 1.0  # standard error of a combination that isn't determined [changes that matter]
_PART = 0.3  # share in a combination that is worth naming

_REASONS = {
    "sensor_x": "it shows only in turns of different curvature",
    "sensor_y": "turns to one side only, or none, don't tell it from the ICRs",
    "drift": "it shows only where speed and turn rate both vary",
    "clock_offset": "it shows only where the driving changes",
    "sensor_yaw": "it needs headings, and driving forwards for some metres",
    "lag": "it shows only where the driving changes fast",
}


def undetermined(fit: Fit) -> tuple[str, str] | None:
    """The parameter to hold because a combination of free ones isn't determined, and why; None if all are."""
    names = [fit.model.names[k] for k in fit.free]
    information = fit.solution.information - np.diag(1 / fit.model.prior[fit.free] ** 2)
    found = vaguest(names, information, fit.model.limits[2][fit.free])
    if found is None:
        return None
    chosen, others = found
    confused = f"the driving can't tell it from {' and '.join(others)}" if others else "the driving doesn't show it"
    reason = _REASONS.get(chosen, "runs of different radii and metres of straight driving do")
    return chosen, f"{confused}; {reason}"


def vaguest(names: Sequence[str], information: Array, scale: Array) -> tuple[str, list[str]] | None:
    """The parameter to hold, and those that it can't be told from; None if all f are determined.

    `information` (f, f) is that of the data alone; it is scaled by the changes that matter, `scale` (f,). Of the
    vaguest combination it is the extra with the largest share, or a parameter of the law if no extra has a part in it.
    """
    size, direction = np.linalg.eigh(information * np.outer(scale, scale))
    if not len(names) or size[0] > 1 / _VAGUE**2:
        return None
    share = np.abs(direction[:, 0])
    parts = [names[k] for k in np.argsort(-share) if share[k] > _PART]
    chosen = next((name for name in parts if name in EXTRAS), parts[0])
    return chosen, [name for name in parts if name != chosen]
