"""A controller of your own, compared with built-in controllers on the same path and ground."""

import numpy as np

import sim
import trackslip


class Proportional:
    """Feedback proportional to the errors ahead, to the left and in heading, in the robot's
    frame.
    """

    def reset(self):
        """Start a new run; this controller has no state to reset."""

    def twist(self, time, pose, reference):
        """Twists (N, 2) [m/s, rad/s] to drive at `time` [s] from measured poses (N, 3)."""
        v, w = reference.twist(time)
        ahead, left, turn = np.moveaxis(trackslip.body_errors(pose, reference.pose(time)), -1, 0)
        return np.stack([v * np.cos(turn) + 0.8 * ahead, w + 8 * v * left + 1.2 * turn], axis=-1)


def main() -> None:
    """Let each controller drive a robot of its own, all in one fleet."""
    robot = sim.load_robot()
    law = trackslip.load_laws(robot=robot.geometry)["icr_radius"]
    reference = trackslip.named_reference("slalom")
    controllers = [
        Proportional(),
        trackslip.LinearTimeVarying(),
        trackslip.Samson(),
        trackslip.PurePursuit(),
    ]
    fleet = sim.Fleet(robot, np.tile(reference.pose(0.0), (len(controllers), 1)))
    pilots = [sim.Pilot(each, [k], trackslip.FixedLaw(law)) for k, each in enumerate(controllers)]
    for controller, log in zip(controllers, sim.closed_loop(fleet, pilots, reference), strict=True):
        errors = trackslip.tracking_errors(log.time, log.pose, reference)
        print(
            f"{type(controller).__name__:18} {1e3 * errors.rms_position:6.1f} mm rms position error"
        )


if __name__ == "__main__":
    main()
