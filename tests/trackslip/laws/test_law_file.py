import json

import pytest
from slip_data import GEOMETRY, grid

from trackslip.errors import LogError
from trackslip.identification.identify import identify_samples
from trackslip.identification.result import identification_to_json
from trackslip.identification.samples import Sampling
from trackslip.kinematics import RobotGeometry
from trackslip.laws.exponential import PUBLISHED
from trackslip.laws.file import SHIPPED, load_laws

ROBOT = '"geometry": {"half_gauge": 0.168, "sprocket_radius": 0.06}'


def test_laws_survive_their_file(tmp_path):
    found = identify_samples(Sampling(grid(PUBLISHED), (), ()), GEOMETRY)
    summary = tmp_path / "summary.json"
    summary.write_text(json.dumps(identification_to_json(found)))
    laws = {name: fit.law for name, fit in found.steady.laws.items() if fit.values}
    assert load_laws(tmp_path) == laws
    assert load_laws(summary) == laws


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not JSON"),
        ("{}", "no slip laws"),
        (
            '{"geometry": {"half_gauge": "abc", "sprocket_radius": 1}, "slip_laws": {}}',
            "no slip laws",
        ),
        ("[1, 2]", "no slip laws"),
        ('{"a": ' * 100_000, "no"),
        ('{"format": 99}', "reads formats up to"),
        (
            f'{{{ROBOT}, "slip_laws": {{"icr": {{"values": {{"offset": 1e308}}}}}}}}',
            r"icr\.offset = 1e\+308: must be",
        ),
        (f'{{{ROBOT}, "slip_laws": {{"icr": {{"values": {{}}}}}}}}', "offset"),
        (
            f'{{{ROBOT.replace("0.168", "-1")}, "slip_laws": {{"icr": {{"values": {{"offset": '
            f"0.1}}}}}}}}",
            "half_gauge",
        ),
    ],
)
def test_files_without_laws(tmp_path, text, message):
    (tmp_path / "laws.json").write_text(text)
    with pytest.raises(LogError, match=message):
        load_laws(tmp_path / "laws.json")
    with pytest.raises(LogError, match="No such file"):
        load_laws(tmp_path / "none.json")
    (tmp_path / "latin.json").write_bytes(b"\xff\xfe{}")
    with pytest.raises(LogError, match="not JSON"):
        load_laws(tmp_path / "latin.json")


def test_laws_of_another_robot_are_refused():
    assert load_laws(SHIPPED, GEOMETRY)
    with pytest.raises(LogError, match=r"the robot has 0\.3 m"):
        load_laws(SHIPPED, RobotGeometry(0.3, 0.06))
