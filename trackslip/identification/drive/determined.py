"""What the driving determines: combinations of parameters that it leaves open, and words for them."""

from __future__ import annotations

import numpy as np

from trackslip.identification.drive.fit import Fit
from trackslip.identification.drive.model import EXTRAS

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
    """The parameter to hold because a combination of free ones isn't determined, and why; None if all are.

    The information is scaled by the changes that matter. The extra with the largest share of the vaguest combination is
    named, or a parameter of the law if no extra has a part in it.
    """
    names = [fit.model.names[k] for k in fit.free]
    scale = fit.model.limits[2][fit.free]
    information = fit.solution.information - np.diag(1 / fit.model.prior[fit.free] ** 2)
    size, direction = np.linalg.eigh(information * np.outer(scale, scale))
    if not names or size[0] > 1 / _VAGUE**2:
        return None
    share = np.abs(direction[:, 0])
    parts = [names[k] for k in np.argsort(-share) if share[k] > _PART]
    chosen = next((name for name in parts if name in EXTRAS), parts[0])
    others = [name for name in parts if name != chosen]
    confused = f"the driving can't tell it from {' and '.join(others)}" if others else "the driving doesn't show it"
    reason = _REASONS.get(chosen, "runs of different radii and metres of straight driving do")
    return chosen, f"{confused}; {reason}"
