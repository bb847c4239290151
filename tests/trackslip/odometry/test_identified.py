import json

import numpy as np
import pytest
from drives import GEOMETRY, ICR
from plain_drives import identified_from, wandered

from experiments.common.plain_json import write_json
from trackslip.errors import LogError, TrackslipError
from trackslip.identification.result import identification_to_json
from trackslip.kinematics import RobotGeometry
from trackslip.laws.base import NoSlip
from trackslip.laws.file import save_laws
from trackslip.laws.icr import ConstantIcr
from trackslip.odometry.identified import identified_law, no_slip
from trackslip.odometry.uncertainty import LawErrors


@pytest.fixture(scope="module")
def found():
    return identified_from(wandered(duration=70.0))


@pytest.fixture
def folder(found, tmp_path):
    write_json(tmp_path / "summary.json", identification_to_json(found))
    return tmp_path


def said_of_errors(law):
    """Names and covariance of a law's parameters, None if they are unknown."""
    if law.errors is None:
        return None
    return law.errors.names, law.errors.covariance.tolist()


@pytest.mark.parametrize("name", [None, "none", "icr", "icr_radius"])
def test_a_folder_holds_the_same_as_the_identification(found, folder, name):
    here = identified_law(found, name)
    there = identified_law(folder, name)
    assert here.name == there.name == (name or found.best)
    assert type(here.law) is type(there.law)
    for about in ("noise", "drift", "mounting", "clock_offset"):
        assert getattr(here, about) == getattr(there, about)
    assert said_of_errors(here) == said_of_errors(there)


def test_a_file_of_laws_knows_nothing_else(tmp_path):
    save_laws(tmp_path / "laws.json", {"icr_radius": ICR}, GEOMETRY)
    used = identified_law(tmp_path / "laws.json")
    assert used.name == "icr_radius"
    assert used.law == ICR
    assert used.geometry == GEOMETRY
    assert used.noise is None
    assert used.errors is None
    assert used.mounting is None
    assert used.clock_offset is None
    assert used.drift == 0.0
    assert identified_law(tmp_path / "laws.json", "none").law == NoSlip() == no_slip(GEOMETRY).law


def test_errors_of_laws_match_intervals_of_95_percent():
    """An interval of 95 % is from -1.96 to 1.96 standard errors; those unknown are left out."""
    fit = {
        "values": {"a": 1.0, "b": 2.0, "c": 3.0, "d": 4.0},
        "stderr": {"a": 0.1, "b": None, "c": 0.3, "d": 0.0},
        "interval95": {"a": [1.0 - 0.392, 1.0 + 0.392], "c": [2.9, 3.1]},
        "correlation": [
            [1.0, 0.9, 0.5, 0.0],
            [0.9, 1.0, 0.0, 0.0],
            [0.5, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
        ],
    }
    errors = LawErrors.stored(fit)
    assert errors.names == ("a", "c")
    between = 0.5 * 0.2 * 0.3
    expected = [[0.2**2, between], [between, 0.3**2]]
    np.testing.assert_allclose(errors.covariance, expected, rtol=1e-4)


def test_what_is_wrong_is_told_in_a_line(found, folder, tmp_path):
    two = tmp_path / "two.json"
    save_laws(two, {"icr_radius": ICR, "icr": ConstantIcr(0.04, 0.168)}, GEOMETRY)
    unknown = "law = 'exponential': must be one of none, icr, icr_radius (in the identification"
    which = "two.json: says nothing of which law is best: choose one of icr, "
    other_robot = "its laws are for half_gauge = 0.168 m and sprocket_radius = 0.06"
    for source, name, robot, message in [
        (found, "exponential", None, unknown),
        (two, None, None, which),
        (folder, "icr", RobotGeometry(0.2, 0.06), other_robot),
    ]:
        with pytest.raises(TrackslipError) as caught:
            identified_law(source, name, robot)
        assert message in str(caught.value)


@pytest.mark.parametrize(
    "damage", [{"noise": {}}, {"extras": {"clock_offset": 0.0, "lag": -(10**400)}}]
)
def test_a_damaged_summary_is_told_in_a_line(folder, damage):
    content = json.loads((folder / "summary.json").read_text())
    fit = content["drive"]["laws"]["icr"]
    for key, value in damage.items():
        fit[key] = fit[key] | value if value else value
    write_json(folder / "summary.json", content)
    with pytest.raises(LogError, match="what it says of law 'icr' is damaged"):
        identified_law(folder, "icr")
