"""`trackslip predict`: slip from theory, without simulating."""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from experiments.options.predict import PredictConfig
from experiments.report.terminal import print_table
from experiments.storage.manifest import make_manifest
from experiments.storage.results import FIGURES_FOLDER, results_folder, write_results
from sim.ground.ground import Ground
from sim.robot.file import load_robot_file
from sim.robot.parameters import RobotParameters
from trackslip.kinematics import Array
from trackslip.logs.file_format import FORMAT
from trackslip.skid_theory import Contact, Load, Turns, line_contact, steady_turns, steady_twist
from trackslip.slip.icr import ConstantIcr

_GRAVITY = 9.81  # [m/s^2]
_HEADER = ("radius driven [m]", "outer slip", "inner slip", "D [mm]", "ICRs, left | right [mm]")


def run(config: PredictConfig) -> None:
    """Compute the slips, store and print them."""
    began = time.perf_counter()
    robot, ground = predicted_world(config)
    load = predicted_load(config, robot)
    if ground.shear == 0 and load == Load():
        _of_coulomb_ground(config, began)
        return
    contact = _contact(robot, ground)
    turns = steady_turns(config.radii, contact, ground.shear, load)
    ahead = 1 - steady_twist([1.0, 1.0], contact, shear=ground.shear, load=load)[0]
    error = (1 + config.radius_error) * (1 - float(turns.loss.mean())) - 1
    law = ConstantIcr(float(turns.offset.mean()), robot.half_gauge, error)
    slip = _nominal(turns.slip, config.radius_error)
    straight = float(_nominal(ahead, config.radius_error))
    with results_folder(config.out) as folder:
        of_turns = {"offset": turns.offset, "icr": {"left": turns.icr[:, 0], "right": turns.icr[:, 1]}}
        under = {"shear": ground.shear, "load": load, "friction": [ground.along, ground.across]}
        _store(config, folder, law, slip, began, {**of_turns, "straight_slip": straight, **under})
        _draw(folder, turns, contact, ground.shear, load)
    rows = [
        (f"{r:g}", f"{s[1]:+.4f}", f"{s[0]:+.4f}", f"{1e3 * d:.2f}", f"{1e3 * y[0]:+.1f} | {1e3 * y[1]:+.1f}")
        for r, s, d, y in zip(config.radii, slip, turns.offset, turns.icr, strict=True)
    ]
    rows.append(("straight", f"{straight:+.4f}", f"{straight:+.4f}", "", ""))
    print_table(f"Slip by quasi-static theory, K = {1e3 * ground.shear:g} mm", _HEADER, rows)
    print(f"mean D = {1e3 * law.offset:.2f} mm; use it with --laws {config.out}")


def _of_coulomb_ground(config: PredictConfig, began: float) -> None:
    law = predict(config)
    slip = law(1 / np.array(config.radii))
    with results_folder(config.out) as folder:
        _store(config, folder, law, slip, began, {})
    rows = [(f"{r:g}", f"{s[1]:+.4f}", f"{s[0]:+.4f}") for r, s in zip(config.radii, slip, strict=True)]
    print_table("Slip by quasi-static Coulomb theory", _HEADER[:3], rows)
    print(f"D = {1e3 * law.offset:.2f} mm; use it with --laws {config.out}")


def _store(
    config: PredictConfig, folder: Path, law: ConstantIcr, slip: Array, began: float, more: dict[str, object]
) -> None:
    robot, _ = predicted_world(config)
    wall = time.perf_counter() - began
    summary = {
        "format": FORMAT,
        "geometry": {"half_gauge": robot.half_gauge, "sprocket_radius": robot.sprocket_radius},
        "slip_laws": {"icr_radius": {"values": {"offset": law.offset, "radius_error": law.radius_error}}},
        "radius": list(config.radii),
        "slip": {"outer": slip[:, 1], "inner": slip[:, 0]},
        **more,
        "timing": {"wall_s": wall, "stages": {"predict": wall}},
    }
    write_results(folder, summary, make_manifest("predict", config, wall))


def _draw(folder: Path, turns: Turns, contact: Contact, shear: float, load: Load) -> None:
    from experiments.report.figures.predict import draw_prediction  # late: matplotlib

    figures = folder / FIGURES_FOLDER
    figures.mkdir()
    draw_prediction(turns, contact, shear, load).savefig(figures / "predict.svg")


def predicted_world(config: PredictConfig) -> tuple[RobotParameters, Ground]:
    """The robot, its centre of mass midway between the tracks, and the ground."""
    robot, ground = load_robot_file(config.robot)
    given = {name: getattr(config, name) for name in ("half_gauge", "contact_length", "com_x", "sprocket_radius")}
    robot = replace(robot, com_y=0.0, **{name: value for name, value in given.items() if value is not None})
    along = ground.along if config.friction is None else config.friction
    ratio = ground.across / ground.along if config.friction_ratio is None else config.friction_ratio
    shear = ground.shear if config.shear is None else config.shear
    return robot, Ground(along, ratio * along, shear=shear)


def predicted_robot(config: PredictConfig) -> tuple[RobotParameters, float]:
    """The robot, its centre of mass midway between the tracks, and the ratio of friction across to along [-]."""
    robot, _ = predicted_world(config)
    _, ground = load_robot_file(config.robot)
    return robot, ground.across / ground.along if config.friction_ratio is None else config.friction_ratio


def predicted_load(config: PredictConfig, robot: RobotParameters) -> Load:
    """The load, whose centre of mass is as high as the robot's."""
    if config.slope == 0 and config.pull == 0:
        return Load()
    return Load(config.slope, config.uphill, config.pull / (robot.mass * _GRAVITY), config.pull_height)


def predict(config: PredictConfig) -> ConstantIcr:
    """The constant ICR of Coulomb theory; raises InvalidValueError where the centre of mass would lift a track."""
    robot, ratio = predicted_robot(config)
    contact = line_contact(
        robot.half_gauge, robot.contact_length / 2, along=1.0, across=ratio, centre_of_mass=(robot.com_x, 0.0, 0.0)
    )
    left, right = 1.0, 1.4  # the result does not depend on the turn
    yaw_rate = steady_twist([left, right], contact)[2]
    return ConstantIcr((right - left) / (2 * yaw_rate) - robot.half_gauge, robot.half_gauge, config.radius_error)


def _contact(robot: RobotParameters, ground: Ground) -> Contact:
    centre = (robot.com_x, 0.0, robot.com_height)
    return line_contact(robot.half_gauge, robot.contact_length / 2, ground.along, ground.across, centre)


def _nominal(slip: Array, radius_error: float) -> Array:
    """Slips (...) with respect to the nominal sprocket radius."""
    return 1 - (1 - slip) * (1 + radius_error)
