"""Follow the paper's path with and without slip compensation; the poses come from the laser
scanner.
"""

import numpy as np

import sim
import trackslip


def main() -> None:
    """Drive three robots with one controller; only the conversion of twists into sprocket speeds
    differs.
    """
    robot = sim.load_robot()
    compensations = {
        "none": trackslip.FixedLaw(),
        "identified": trackslip.FixedLaw(trackslip.load_laws(robot=robot.geometry)["icr_radius"]),
        "learnt online": trackslip.OnlineIcr(robot.geometry),
    }
    reference = trackslip.paper_reference()
    fleet = sim.Fleet(robot, np.tile(reference.pose(0.0), (len(compensations), 1)))
    controller = trackslip.LinearTimeVarying
    pilots = [sim.Pilot(controller(), [k], way) for k, way in enumerate(compensations.values())]
    feed = sim.ScannerFeed(
        sim.LaserScanner(), fleet, [np.random.default_rng(k) for k in range(fleet.size)]
    )
    logs = sim.closed_loop(fleet, pilots, reference, feed, trackslip.PlateLocator())
    for name, log in zip(compensations, logs, strict=True):
        errors = trackslip.tracking_errors(log.time, log.truth.pose, reference)
        rms, last = 1e3 * errors.rms_position, 1e3 * errors.final_position
        print(f"{name:14} {rms:6.1f} mm rms position error, {last:6.1f} mm at the end")


if __name__ == "__main__":
    main()
