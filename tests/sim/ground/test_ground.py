"""Grounds: patches and changes under each pad, names, files, and what is refused."""

import re

import numpy as np
import pytest
from pages import ROOT, file

from sim.ground.ground import Change, Ground, Patch
from sim.ground.named import NAMED_GROUNDS, load_ground
from sim.ground.pad_friction import PadFriction
from trackslip.errors import InvalidValueError, SettingsFileError

PAGE = ROOT / "docs" / "grounds_and_robots.md"
PADS = np.array([[0.1, 0.2], [0.1, -0.2]])


def test_patches_act_under_the_pads_that_are_on_them():
    patch = Patch((0.0, 1.0), (0.0, 1.0), 0.2, 0.3)
    upper = Patch((0.5, 1.0), (0.0, 1.0), 0.9, 0.8)
    friction = PadFriction([Ground(0.5, 0.6), Ground(0.5, 0.6, patches=(patch, upper))], PADS)
    assert friction.varies
    at = np.array([[0.2, 0.1], [0.2, 0.1]])
    first, second = friction.at(0.0, at, np.zeros(2))
    np.testing.assert_allclose(first, [[0.5, 0.6], [0.5, 0.6]])
    np.testing.assert_allclose(second, [[0.2, 0.3], [0.5, 0.6]])  # the right pad is at y = -0.1
    turned = friction.at(0.0, at, np.full(2, np.pi))[1]  # now the left pad is at y = -0.1, the right at (0.1, 0.3)
    np.testing.assert_allclose(turned, [[0.5, 0.6], [0.2, 0.3]])
    on_both = friction.at(0.0, np.add(at, [0.4, 0.0]), np.zeros(2))[1]
    np.testing.assert_allclose(on_both[0], [0.9, 0.8])  # the last counts


def test_of_many_patches_the_last_under_each_pad_counts():
    rng = np.random.default_rng(0)
    robots, few, many = 4, 3, 400
    grounds = []
    for count in (many, few, 0, many):
        low, size = rng.uniform(-3, 3, (count, 2)), rng.uniform(0.1, 1.0, (count, 2))
        frictions = rng.uniform(0.1, 1.0, (count, 2))
        patches = [Patch((x, x + a), (y, y + b), *mu) for (x, y), (a, b), mu in zip(low, size, frictions, strict=True)]
        grounds.append(Ground(patches=tuple(patches)))
    friction = PadFriction(grounds, PADS)
    position, heading = rng.uniform(-2, 2, (robots, 2)), rng.uniform(-np.pi, np.pi, robots)
    for _ in range(100):
        position, heading = position + rng.uniform(-0.1, 0.1, (robots, 2)), heading + 0.1
        found = friction.at(0.0, position, heading)
        for i, ground in enumerate(grounds):
            cos, sin = np.cos(heading[i]), np.sin(heading[i])
            for j, (a, b) in enumerate(PADS):
                x, y = position[i] + (cos * a - sin * b, sin * a + cos * b)
                expected = (ground.along, ground.across)
                for patch in ground.patches:
                    if patch.x[0] <= x < patch.x[1] and patch.y[0] <= y < patch.y[1]:
                        expected = (patch.along, patch.across)
                assert tuple(found[i, j]) == expected
        if rng.random() < 0.1:
            friction.replace(np.array([1]), [grounds[0]])
            grounds[1] = grounds[0]


def test_a_ground_has_a_limited_number_of_patches():
    patch = Patch((0.0, 1.0), (0.0, 1.0), 0.2, 0.3)
    with pytest.raises(InvalidValueError, match="number of patches = 10001: must be at most 10000"):
        Ground(patches=(patch,) * 10_001)


def test_changes_take_effect_at_their_times_outside_patches():
    patch = Patch((-np.inf, np.inf), (0.0, np.inf), 0.2, 0.3)
    ground = Ground(0.5, 0.6, patches=(patch,), changes=(Change(1.0, 0.7, 0.8), Change(2.0, 0.1, 0.1)))
    friction = PadFriction([ground, Ground()], PADS)
    for time, right in ((0.0, (0.5, 0.6)), (0.99, (0.5, 0.6)), (1.0, (0.7, 0.8)), (2.5, (0.1, 0.1))):
        found = friction.at(time, np.zeros((2, 2)), np.zeros(2))
        np.testing.assert_allclose(found[0], [(0.2, 0.3), right])
        np.testing.assert_allclose(found[1], [(0.7, 0.778)] * 2)


def test_even_ground_never_varies():
    assert not PadFriction([Ground(), Ground(slope=0.1)], PADS).varies


def test_gravity_points_downhill():
    np.testing.assert_allclose(
        Ground(slope=0.3, uphill=0.0).gravity(9.81), 9.81 * np.array([-np.sin(0.3), 0, -np.cos(0.3)])
    )
    np.testing.assert_allclose(
        Ground(slope=0.3, uphill=np.pi / 2).gravity(9.81)[:2], [0, -9.81 * np.sin(0.3)], atol=1e-12
    )


def test_the_page_lists_the_named_grounds():
    rows = re.findall(r"^\| `(\w+)` \| ([\d.]+) \| ([\d.]+) \| (\d+) \| (.+) \|$", PAGE.read_text(), re.MULTILINE)
    listed = {name: (float(along), float(across), float(shear), source) for name, along, across, shear, source in rows}
    known = NAMED_GROUNDS.items()
    assert listed == {name: (n.ground.along, n.ground.across, 1e3 * n.ground.shear, n.source) for name, n in known}
    hard = {"stone", "concrete", "rubber", "packed_soil", "gravel", "wet", "sticky", "ice"}
    assert set(NAMED_GROUNDS) == hard | {"firm_sand", "loose_sand", "clay", "snow"}
    assert {name for name, n in known if n.ground.shear == 0} == hard
    for named in NAMED_GROUNDS.values():
        assert any(word in named.source for word in ("assumed", "Noon", "Wong"))


def test_the_example_on_the_page_is_a_ground(tmp_path):
    (tmp_path / "ground.toml").write_text(file(PAGE, "ground.toml"))
    ground = load_ground(str(tmp_path / "ground.toml"))
    assert ground.along == NAMED_GROUNDS["gravel"].ground.along
    assert ground.slope == 0.1
    assert ground.patches == (Patch((0.0, 2.0), (-1.0, 1.0), 0.12, 0.12),)
    assert ground.changes == (Change(20.0, 0.5, 0.7),)


def test_names():
    assert load_ground("ice") is NAMED_GROUNDS["ice"].ground
    with pytest.raises(InvalidValueError, match="ground = 'mud': must be one of stone, concrete"):
        load_ground("mud")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("along = -1.0", "along = -1.0: must be a finite number > 0"),
        ("along = 'much'", "along = 'much': must be a number"),
        ("along = true", "along = True: must be a number"),
        ("along = nan", "along = nan"),
        ("across = 99", "across = 99.0: must be at most 10"),
        ("slope = 2.0", "slope = 2.0: must be at most 1.5 rad"),
        ("grip = 1.0", "grip is unknown; known are along, across"),
        ("base = 'mud'", "base = 'mud': must be one of"),
        ("along = ", "not TOML"),
        ("patches = 3", "patches = 3: must be a list"),
        ("[[patches]]\nx = [0, 1]\ny = [0, 1]\nalong = 0.5", "patches[0]: across is missing"),
        (
            "[[patches]]\nx = [0, 1, 2]\ny = [0, 1]\nalong = 0.5\nacross = 0.5",
            "x = (0.0, 1.0, 2.0): must be two ascending",
        ),
        ("[[patches]]\nx = [1, 0]\ny = [0, 1]\nalong = 0.5\nacross = 0.5", "x = (1.0, 0.0): must be two ascending"),
        ("[[changes]]\ntime = -1\nalong = 0.5\nacross = 0.5", "time = -1.0: must be a finite number >= 0"),
        (
            "changes = [{time = 2, along = 1, across = 1}, {time = 1, along = 1, across = 1}]",
            "changes = [2.0, 1.0]: must be in ascending order",
        ),
        ("patches = [3]", "patches[0]: 3 is not a table"),
    ],
)
def test_bad_files_are_refused_by_field(tmp_path, text, message):
    path = tmp_path / "ground.toml"
    path.write_text(text)
    with pytest.raises(SettingsFileError) as error:
        load_ground(str(path))
    assert message in str(error.value)
    assert "ground.toml" in str(error.value)
    assert "\n" not in str(error.value).strip()


def test_files_that_cannot_be_read(tmp_path):
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "folder.toml").mkdir()
    for name, message in (("none.toml", "No such file"), ("binary.toml", "not text"), ("folder.toml", "directory")):
        with pytest.raises(SettingsFileError, match=message):
            load_ground(str(tmp_path / name))
