"""Laws with what an identification knows beside them."""

import json

import numpy as np
import pytest
from drives import GEOMETRY, ICR, drive_log
from wandered import identified_from, wandered

from experiments.common.plain_json import write_json
from sim.wander.commands import Driver, track_commands
from sim.wander.motion import WHITE, LawMotion
from sim.wander.pose_source import SOURCES
from trackslip.errors import LogError, TrackslipError
from trackslip.identification.identify import identify
from trackslip.identification.law_fit import fit_drives
from trackslip.identification.result import identification_to_json
from trackslip.kinematics import RobotGeometry
from trackslip.laws.base import NoSlip
from trackslip.laws.file import save_laws
from trackslip.laws.icr import ConstantIcr
from trackslip.logs.runlog import RunLog
from trackslip.odometry.identified import identified_law, no_slip
from trackslip.odometry.slip_odometry import SlipOdometry
from trackslip.odometry.uncertainty import LawErrors, SlipNoise


@pytest.fixture(scope="module")
def found():
    return identified_from(wandered(duration=70.0))


@pytest.fixture
def folder(found, tmp_path):
    write_json(tmp_path / "summary.json", identification_to_json(found))
    return tmp_path


def test_everything_comes_from_the_fit_to_whole_drives(found):
    used, fit = identified_law(found, "icr_radius"), found.drive.laws["icr_radius"]
    assert used.law == fit.law
    assert used.noise == SlipNoise.of(fit.noise)
    assert used.drift == fit.extras["drift"]
    assert (used.mounting.x, used.mounting.y) == (fit.extras["sensor_x"], fit.extras["sensor_y"])
    assert used.clock_offset == fit.extras["clock_offset"] - fit.extras["lag"]
    assert used.errors.names == ("offset", "radius_error")
    errors = np.sqrt(np.diag(used.errors.covariance))
    for name, error in zip(used.errors.names, errors, strict=True):
        half = (fit.interval95[name][1] - fit.interval95[name][0]) / 2
        assert error == pytest.approx(max(fit.stderr[name], half / 1.96), rel=1e-4)
    assert used.errors.covariance[0, 1] == pytest.approx(fit.correlation[0, 1] * np.prod(errors))


@pytest.mark.parametrize("name", [None, "none", "icr", "icr_radius"])
def test_a_folder_holds_the_same_as_the_identification(found, folder, name):
    here, there = identified_law(found, name), identified_law(folder, name)
    assert here.name == there.name == (name or found.best)
    assert type(here.law) is type(there.law)
    assert (here.noise, here.drift, here.mounting, here.clock_offset) == (
        there.noise, there.drift, there.mounting, there.clock_offset,
    )  # fmt: skip
    if here.errors is None or there.errors is None:
        assert here.errors is there.errors is None
    else:
        assert here.errors.names == there.errors.names
        np.testing.assert_array_equal(here.errors.covariance, there.errors.covariance)


def test_laws_of_steady_stretches_have_their_own_errors():
    rng = np.random.default_rng(0)
    time, runs = np.arange(200) / 20.0, []
    for w in (-0.4, -0.2, 0.0, 0.2, 0.4, 0.3):
        omega = np.tile(ICR.sprocket_speeds([0.2, w], GEOMETRY), (len(time), 1))
        motion, _ = LawMotion(ICR, GEOMETRY, WHITE).drive(omega, 20.0, rng)
        runs.append(RunLog(f"{w}", time, omega, motion.at(time)))
    found = identify(runs, GEOMETRY, method="steady")
    used, fit = identified_law(found, "icr_radius"), found.comparison.laws["icr_radius"]
    assert used.law == fit.law
    assert np.sqrt(used.errors.covariance[0, 0]) >= fit.stderr["offset"]


def test_a_file_of_laws_knows_nothing_else(tmp_path):
    save_laws(tmp_path / "laws.json", {"icr_radius": ICR}, GEOMETRY)
    used = identified_law(tmp_path / "laws.json")
    assert (used.name, used.law, used.geometry) == ("icr_radius", ICR, GEOMETRY)
    assert (used.noise, used.errors, used.mounting, used.clock_offset, used.drift) == (None, None, None, None, 0.0)
    assert identified_law(tmp_path / "laws.json", "none").law == NoSlip() == no_slip(GEOMETRY).law


def test_what_is_wrong_is_told_in_a_line(found, folder, tmp_path):
    save_laws(tmp_path / "two.json", {"icr_radius": ICR, "icr": ConstantIcr(0.04, 0.168)}, GEOMETRY)
    other = RobotGeometry(0.2, 0.06)
    for source, name, robot, message in [
        (folder, "exponential", None, "law = 'exponential': must be one of none, icr, icr_radius (in "),
        (found, "exponential", None, "(in the identification)"),
        (tmp_path / "two.json", None, None, "two.json: says nothing of which law is best: choose one of icr, "),
        (folder, "icr", other, "its laws are for half_gauge = 0.168 m and sprocket_radius = 0.06 m"),
        (found, "icr", other, "the identification: its laws are for half_gauge = 0.168 m"),
        (tmp_path / "nowhere", "icr", None, "nowhere: No such file or directory"),
    ]:
        with pytest.raises(TrackslipError) as caught:
            identified_law(source, name, robot)
        assert message in str(caught.value)


@pytest.mark.parametrize("damage", [{"noise": {}}, {"extras": {"clock_offset": 0.0, "lag": -(10**400)}}])
def test_a_damaged_summary_is_told_in_a_line(folder, damage):
    content = json.loads((folder / "summary.json").read_text())
    fit = content["drive"]["laws"]["icr"]
    fit |= {key: fit[key] | value if value else value for key, value in damage.items()}
    write_json(folder / "summary.json", content)
    with pytest.raises(LogError, match="what it says of law 'icr' is damaged"):
        identified_law(folder, "icr")


def test_held_parameters_have_no_error():
    fit = {"values": {"a": 1.0, "b": 2.0}, "stderr": {"b": 0.5, "sensor_x": 1.0}}
    errors = LawErrors.stored(fit | {"correlation": [[1.0, 0.3], [0.3, 1.0]]})
    assert errors.names == ("b",)
    np.testing.assert_allclose(errors.covariance, [[0.25]])


@pytest.mark.slow
def test_an_identification_knows_how_wrong_odometry_is():
    """Identified from two minutes with a good sensor, other drives' ends are about as far off as odometry says."""
    found = []
    for seed in range(20):
        drive = fit_drives("icr_radius", [drive_log(seed, 120.0, SOURCES["scanner"])], GEOMETRY)
        fit = {"values": drive.values, "stderr": drive.stderr, "correlation": drive.correlation}
        errors = LawErrors.stored(fit)
        odometry = SlipOdometry(drive.law, GEOMETRY, SlipNoise.of(drive.noise), errors)
        rng = np.random.default_rng([seed, 1])
        omega = track_commands("random", 30.0, 50.0, Driver(), rng) / GEOMETRY.sprocket_radius
        path = odometry.path(np.arange(len(omega)) / 50.0, omega)
        for _ in range(20):
            end = LawMotion(ICR, GEOMETRY, WHITE).drive(omega, 50.0, rng)[0].pose[-1]
            error = end - path.pose[-1]
            found.append(error @ np.linalg.solve(path.covariance[-1], error))
    assert 2.5 < np.mean(found) < 3.6
