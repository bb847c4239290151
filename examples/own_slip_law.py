"""A slip law of your own: fitted, compared with the built-in laws, shown in the report, and saved.

The command line finds it by the name of this module:
PYTHONPATH=examples trackslip track --laws out/own_slip_law/laws.json \\
    --compensation own_slip_law:linear
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import sim
import trackslip
from trackslip.laws.families import FAMILIES, LawFamily, Parameter


@dataclass(frozen=True)
class Linear(trackslip.SlipLaw):
    """Slip linear in curvature, i = offset -+ gain kappa; parameters may be arrays, for many laws
    at once.
    """

    offset: float  # [-]
    gain: float  # [m]

    def __call__(self, kappa):
        """Slips (..., 2) of the left and right track at curvatures (...) [1/m]."""
        return np.stack([self.offset - self.gain * kappa, self.offset + self.gain * kappa], axis=-1)


# initial values of fits, both limits, a significant change, unit, symbol, meaning; lengths are in
# half gauges
PARAMETERS = {
    "offset": Parameter((0.0,), -0.5, 0.5, 0.01, "", "o", "slip on a straight path"),
    "gain": Parameter((0.3,), -5.0, 5.0, 0.3, "m", "k", "growth of slip with curvature"),
}


# `identify` fits all families, and laws in files are found by the names of their families
FAMILIES["linear"] = LawFamily("linear in curvature", PARAMETERS, lambda p, _: Linear(**p))


def main(folder: Path = Path("out/own_slip_law")) -> None:
    """Drive, identify, report, and save the law."""
    folder.mkdir(parents=True, exist_ok=True)
    robot = sim.load_robot()
    omega = trackslip.NoSlip().sprocket_speeds(
        [(0.15, 0.15 / r) for r in (0.6, 0.8, 1.0, 1.5, 2.0)], robot.geometry
    )
    fleet = sim.Fleet(robot, np.zeros((len(omega), 3)))
    found = trackslip.identify(sim.open_loop(fleet, omega, 12.0), robot.geometry)
    for name, law in found.laws.items():
        print(f"{name} misses the slip by {found.comparison.laws[name].rms:.5f} rms: {law}")
    found.report(folder / "report.html")
    trackslip.save_laws(folder / "laws.json", {"linear": found.laws["linear"]}, robot.geometry)


if __name__ == "__main__":
    main()
