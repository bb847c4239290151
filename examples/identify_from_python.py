"""Identify slip laws from simulated runs: the laws, their intervals, and a report."""

from pathlib import Path

import numpy as np

import sim
import trackslip

RADII = (0.6, 1.0, 1.5, 2.5)  # [m]
SPEEDS = (0.1, 0.2)  # [m/s]


def main(folder: Path = Path("out/identify_from_python")) -> None:
    """Drive, identify and report; `trackslip.identify` also accepts results folders and log files
    of real robots.
    """
    robot = sim.load_robot()
    twist = np.array([(speed, speed / radius) for radius in RADII for speed in SPEEDS])
    fleet = sim.Fleet(robot, np.zeros((len(twist), 3)))
    logs = sim.open_loop(fleet, trackslip.NoSlip().sprocket_speeds(twist, robot.geometry), 12.0)
    found = trackslip.identify(logs, robot.geometry)
    print(found)
    for name, (low, high) in found.intervals["icr_radius"].items():
        print(f"icr_radius: {name} is between {low:.4f} and {high:.4f}")
    folder.mkdir(parents=True, exist_ok=True)
    trackslip.save_laws(folder / "laws.json", found.laws, robot.geometry)
    print(found.report(folder / "report.html"))


if __name__ == "__main__":
    main()
