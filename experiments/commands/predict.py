"""`trackslip predict`: a slip law from theory, without simulating."""

import time
from dataclasses import replace

import numpy as np

from experiments.options.predict import PredictConfig
from experiments.report.terminal import print_table
from experiments.storage.manifest import make_manifest
from experiments.storage.results import results_folder, write_results
from sim.robot.file import load_robot_file
from sim.robot.parameters import RobotParameters
from trackslip.logs.file_format import FORMAT
from trackslip.skid_theory import line_contact, steady_twist
from trackslip.slip.icr import ConstantIcr


def run(config: PredictConfig) -> None:
    """Compute the law, store and print it."""
    began = time.perf_counter()
    robot, _ = predicted_robot(config)
    law = predict(config)
    slip = law(1 / np.array(config.radii))
    with results_folder(config.out) as folder:
        wall = time.perf_counter() - began
        summary = {
            "format": FORMAT,
            "geometry": {"half_gauge": robot.half_gauge, "sprocket_radius": robot.sprocket_radius},
            "slip_laws": {"icr_radius": {"values": {"offset": law.offset, "radius_error": law.radius_error}}},
            "radius": list(config.radii),
            "slip": {"outer": slip[:, 1], "inner": slip[:, 0]},
            "timing": {"wall_s": wall, "stages": {"predict": wall}},
        }
        write_results(folder, summary, make_manifest("predict", config, wall))
    rows = [(f"{r:g}", f"{s[1]:+.4f}", f"{s[0]:+.4f}") for r, s in zip(config.radii, slip, strict=True)]
    print_table("Slip by quasi-static Coulomb theory", ("radius driven [m]", "outer slip", "inner slip"), rows)
    print(f"D = {1e3 * law.offset:.2f} mm; use it with --laws {config.out}")


def predicted_robot(config: PredictConfig) -> tuple[RobotParameters, float]:
    """The robot, its centre of mass midway between the tracks, and the ratio of friction across to along [-]."""
    robot, ground = load_robot_file(config.robot)
    given = {name: getattr(config, name) for name in ("half_gauge", "contact_length", "com_x", "sprocket_radius")}
    robot = replace(robot, com_y=0.0, **{name: value for name, value in given.items() if value is not None})
    return robot, ground.across / ground.along if config.friction_ratio is None else config.friction_ratio


def predict(config: PredictConfig) -> ConstantIcr:
    """The constant ICR of theory; raises InvalidValueError for a centre of mass that would lift part of a track."""
    robot, ratio = predicted_robot(config)
    contact = line_contact(
        robot.half_gauge, robot.contact_length / 2, along=1.0, across=ratio, centre_of_mass=(robot.com_x, 0.0, 0.0)
    )
    left, right = 1.0, 1.4  # the result does not depend on the turn
    yaw_rate = steady_twist([left, right], contact)[2]
    return ConstantIcr((right - left) / (2 * yaw_rate) - robot.half_gauge, robot.half_gauge, config.radius_error)
