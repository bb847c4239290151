"""Drive three robots on two grounds in front of the laser scanner, and store the runs."""

from pathlib import Path

import numpy as np

import sim
import trackslip
from trackslip.logs.logfile import write_parquet


def main(file: Path = Path("out/fleet.parquet"), duration: float = 10.0) -> None:
    """Drive each robot at constant sprocket speeds, and log the poses that the scanner measures."""
    robot = sim.load_robot()
    start = np.array([[-1.5, 0.5, 0.0], [-1.5, 0.5, 0.0], [-1.5, 0.5, 0.0]])  # x, y [m], phi [rad]
    grounds = [
        sim.Ground(along=0.8, across=0.8),
        sim.Ground(along=0.8, across=0.8),
        sim.Ground(along=0.4, across=0.3),
    ]
    fleet = sim.Fleet(robot, start, grounds)
    generators = [np.random.default_rng(seed) for seed in range(fleet.size)]
    feed = sim.ScannerFeed(sim.LaserScanner(noise=0.005), fleet, generators)
    omega = np.array([[2.0, 3.0], [3.0, 4.0], [2.0, 3.0]])  # left, right [rad/s]
    logs = sim.open_loop(fleet, omega, duration, feed, trackslip.PlateLocator())
    file.parent.mkdir(parents=True, exist_ok=True)
    write_parquet(logs, file)
    for log in trackslip.load(file):
        v, _, w = log.truth.twist[-1]
        print(f"{log!r}\n  drives a circle of radius {v / w:.2f} m")


if __name__ == "__main__":
    main()
