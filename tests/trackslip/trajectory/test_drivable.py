"""References that are faster than the tracks of a robot."""

import numpy as np
import pytest

from trackslip.errors import InvalidValueError
from trackslip.kinematics import RobotGeometry
from trackslip.laws.base import NoSlip
from trackslip.laws.file import load_laws
from trackslip.laws.icr import ConstantIcr, IcrSides
from trackslip.trajectory.drivable import Demand, require_drivable
from trackslip.trajectory.named import load_reference
from trackslip.trajectory.segmented import Segment, SegmentedReference, circle

SHIPPED = RobotGeometry(0.168, 0.06)
HUSKY = RobotGeometry(0.2854, 0.1651)
STEEP = SegmentedReference(
    (0.0, 0.0, 0.0), [Segment(4.0, 0.0, 0.2, 0.5), Segment(4.0, -0.1, -0.3, -2.0)]
)


@pytest.mark.parametrize("geometry", [SHIPPED, HUSKY])
@pytest.mark.parametrize("radius", [0.5, -2.0])
def test_the_outer_track_of_a_circle_demands_most(geometry, radius):
    law = ConstantIcr(0.05, geometry.half_gauge, 0.01)
    demand = Demand.of(circle(radius, 0.25, 10.0), law, geometry)
    reach = geometry.half_gauge + 0.05
    expected = 0.25 * (1 + reach / abs(radius)) / 1.01
    assert demand.track_speed == pytest.approx(expected)
    assert demand.speed == 0.25
    assert demand.possible_speed(0.3) == pytest.approx(0.25 * 0.3 / expected, rel=0.01)


@pytest.mark.parametrize("law", [*load_laws().values(), NoSlip()])
def test_a_circle_at_the_speed_that_is_possible_is_drivable(law):
    fast = Demand.of(circle(0.5, 0.29, 10.0), law, SHIPPED)
    assert fast.exceeds(0.3)
    speed = fast.possible_speed(0.3)
    assert not Demand.of(circle(0.5, speed, 10.0), law, SHIPPED).exceeds(0.3)
    assert Demand.of(circle(0.5, 1.02 * speed, 10.0), law, SHIPPED).exceeds(0.3)


def test_each_of_two_unequal_tracks_counts_in_its_own_turns():
    law = IcrSides(0.0, 0.2, 0.0, 0.0, SHIPPED.half_gauge)
    to_the_left = Demand.of(circle(1.0, 0.2, 10.0), law, SHIPPED)
    to_the_right = Demand.of(circle(-1.0, 0.2, 10.0), law, SHIPPED)
    assert to_the_left.track_speed == pytest.approx(0.2 * (1 + 0.368))
    assert to_the_right.track_speed == pytest.approx(0.2 * (1 + 0.168))


def test_the_end_of_a_ramp_in_reverse_is_found():
    demand = Demand.of(STEEP, NoSlip(), SHIPPED)
    assert demand.track_speed == pytest.approx(0.3 * (1 + 2 * 0.168), rel=1e-6)
    assert demand.time == pytest.approx(8.0)


def test_a_refusal_names_the_demand_and_a_possible_speed():
    with pytest.raises(InvalidValueError) as refusal:
        require_drivable("reference", "steep", STEEP, NoSlip(), SHIPPED, 0.3)
    assert str(refusal.value) == (
        "reference = 'steep': must be slow enough for the robot, at most 0.224 instead of 0.3 m/s: "
        "the faster track takes 0.401 m/s at 8.0 s, and drive.top_speed is 0.3 m/s"
    )


@pytest.mark.parametrize("name", ["paper", "figure_eight", "spiral", "stop_and_go"])
@pytest.mark.parametrize("law", [*load_laws().values(), NoSlip()])
def test_the_shipped_robot_can_drive_the_shipped_references(name, law):
    require_drivable("reference", name, load_reference(name), law, SHIPPED, 0.3)


class Waves:
    """A reference of another library, which has no knots."""

    duration = 20.0

    def pose(self, time):
        raise NotImplementedError

    def twist(self, time):
        time = np.asarray(time, float)
        speed = 0.2 + 0.1 * np.sin(time)
        return np.stack([speed, 0 * speed], axis=-1)


def test_references_without_knots_are_examined_closely():
    demand = Demand.of(Waves(), NoSlip(), SHIPPED)
    assert demand.track_speed == pytest.approx(0.3, rel=1e-4)
