"""What commands say about robots on soft soil, compared with integrals over their contacts."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from experiments.common.soil import OnSoil
from sim.ground.ground import NAMED_GROUNDS
from sim.robot.named import load_parameters
from trackslip.errors import InvalidValueError
from trackslip.skid_theory import Load, drawbar_curve

LOAM = NAMED_GROUNDS["upland_loam"].soil
SAND = NAMED_GROUNDS["dry_sand"].soil
HUSKY, _ = load_parameters("husky")
SHIPPED, _ = load_parameters("shipped")
LOAD = Load(slope=0.05, pull=0.1, hitch_height=0.2)
ROOT = np.tan(np.pi / 4 + LOAM.friction_angle / 2)
"""Square root of Rankine's coefficient of passive earth pressure."""


def bekker(soil, depth, width):
    """Pressure at a depth without slip [Pa]."""
    return (soil.k_c / width + soil.k_phi) * depth**soil.n


class WheelByHand:
    """A wheel that presses a rut of the depth `ahead` of it down to its own [m]."""

    def __init__(self, load, ahead):
        """The depth at which the pressures under its front half bear the `load` [N]."""
        self.ahead = ahead
        self.depth = brentq(lambda depth: self._bears(depth) - load, ahead + 1e-6, ahead + 0.1)
        self.entry = self._entry(self.depth)

    def _entry(self, depth):
        """Distance ahead of the axle at which the wheel meets the ground [m]."""
        return np.sqrt(HUSKY.sprocket_radius**2 - (HUSKY.sprocket_radius - depth + self.ahead) ** 2)

    def _pressure(self, x, depth):
        """Pressure at a distance x ahead of the axle [Pa]."""
        rise = HUSKY.sprocket_radius - np.sqrt(HUSKY.sprocket_radius**2 - x**2)
        return bekker(LOAM, depth - rise, HUSKY.track_width)

    def _bears(self, depth):
        return HUSKY.track_width * quad(self._pressure, 0, self._entry(depth), depth)[0]

    @property
    def work(self):
        """Work to press the rut, per distance [N]."""
        width = HUSKY.track_width
        return width * quad(lambda z: bekker(LOAM, z, width), self.ahead, self.depth)[0]

    @property
    def sheared(self):
        """Mean distance behind the entry, weighted by the pressure [m]."""
        of_pressure = quad(self._pressure, 0, self.entry, self.depth)[0]
        moment = quad(lambda x: (self.entry - x) * self._pressure(x, self.depth), 0, self.entry)[0]
        return moment / of_pressure

    @property
    def pushed(self):
        """Lateral force on the part below the ground, a parabola over its chord [N]."""
        radius = HUSKY.sprocket_radius
        half_chord = np.sqrt(radius**2 - (radius - self.depth) ** 2)

        def per_length(x):
            depth = self.depth * (1 - (x / half_chord) ** 2)
            of_weight = LOAM.unit_weight * ROOT**2 * depth**2 / 2
            return of_weight + 2 * LOAM.cohesion * ROOT * depth

        return quad(per_length, -half_chord, half_chord)[0]


def test_wheels_turn_with_means_over_all_four():
    weight = HUSKY.mass * 9.81
    front = WheelByHand(weight / 4, 0.0)
    rear = WheelByHand(weight / 4, front.depth)
    on_soil = OnSoil(HUSKY, LOAM, LOAD)
    assert on_soil.sinkage == pytest.approx(rear.depth, rel=1e-3)
    pressure = weight / 4 / (HUSKY.track_width * front.entry)
    assert on_soil.pressure == pytest.approx(pressure, rel=1e-3)
    resistance = 2 * front.work + 2 * rear.work
    assert on_soil.resistance == pytest.approx(resistance, rel=1e-3)

    contact, shear, load = on_soil.turning()
    area = 2 * HUSKY.track_width * (front.entry + rear.entry)
    along = np.tan(LOAM.friction_angle) + LOAM.cohesion * area / weight
    assert contact.along == pytest.approx(along, rel=1e-3)
    pushed = 2 * front.pushed + 2 * rear.pushed
    assert contact.across == pytest.approx(along + pushed / weight, rel=1e-3)

    # a patch is sheared at the shear modulus over its length as soil is under the arcs
    mean_distance = (front.sheared + rear.sheared) / 2
    assert HUSKY.patch_length / 2 / shear == pytest.approx(mean_distance / LOAM.shear, rel=1e-2)

    # the resistance is pulled at the axles
    pull = LOAD.pull + resistance / weight
    moment = LOAD.pull * 0.2 + resistance / weight * HUSKY.sprocket_radius
    assert load.pull == pytest.approx(pull, rel=1e-3)
    assert load.hitch_height == pytest.approx(moment / pull, rel=1e-3)
    assert load.slope == LOAD.slope


def test_tracks_turn_with_friction_of_the_mean_pressure():
    weight = SHIPPED.mass * 9.81
    width = SHIPPED.track_width
    pressure = weight / (2 * width * SHIPPED.contact_length)
    on_soil = OnSoil(SHIPPED, SAND, LOAD)
    assert on_soil.pressure == pytest.approx(pressure)
    assert bekker(SAND, on_soil.sinkage, width) == pytest.approx(pressure)
    resistance = 2 * width * quad(lambda z: bekker(SAND, z, width), 0, on_soil.sinkage)[0]
    assert on_soil.resistance == pytest.approx(resistance)

    contact, shear, load = on_soil.turning()
    along = np.tan(SAND.friction_angle) + SAND.cohesion / pressure
    root = np.tan(np.pi / 4 + SAND.friction_angle / 2)
    depth = on_soil.sinkage
    bulldozed = 2 * SAND.cohesion * root * depth + SAND.unit_weight * root**2 * depth**2 / 2
    assert contact.along == pytest.approx(along)
    assert contact.across == pytest.approx(along + bulldozed / (width * pressure))
    assert shear == SAND.shear
    assert load == Load(LOAD.slope, 0.0, LOAD.pull + on_soil.resistance / weight, 0.2)


@pytest.mark.parametrize("robot", [SHIPPED, HUSKY], ids=["tracks", "wheels"])
def test_the_best_of_a_summary_are_states_of_its_curve(robot):
    on_soil = OnSoil(robot, LOAM, LOAD)
    curve = on_soil.curve()
    summary = on_soil.summary(curve)
    pull = summary["most_pull"]["pull"]
    assert pull == max(curve.pull)
    assert summary["most_pull"]["slip"] == curve.slip[curve.pull.argmax()]
    best = np.nanargmax(np.where(curve.pull > 0, curve.efficiency, np.nan))
    assert summary["most_efficiency"]["efficiency"] == curve.efficiency[best]
    assert summary["most_efficiency"]["slip"] == curve.slip[best]
    # at the slip under the load, what is left to pull up the slope is just that load
    loaded = drawbar_curve(LOAM, on_soil.gear, [summary["slip_under_load"]], LOAD.slope, 0.2)
    assert loaded.pull[0] == pytest.approx(LOAD.pull * robot.mass * 9.81, rel=1e-4)


@pytest.mark.parametrize("robot", [SHIPPED, HUSKY], ids=["tracks", "wheels"])
def test_printed_numbers_on_soil_have_their_units(robot, capsys):
    on_soil = OnSoil(robot, LOAM, LOAD)
    curve = on_soil.curve()
    on_soil.print(curve)
    printed = capsys.readouterr().out
    weight = robot.mass * 9.81
    most = curve.pull.argmax()
    slip = curve.slip[most]
    of_most = f"{curve.pull[most]:.1f} N ({100 * curve.pull[most] / weight:.1f} % of the weight)"
    assert f"{of_most}, at slip {slip:.2f}" in printed
    share = 100 * on_soil.resistance / weight
    assert f"{on_soil.resistance:.1f} N ({share:.1f} % of the weight)" in printed
    assert f"{1e3 * robot.track_width:.0f} mm wide" in printed
    assert f"{1e-3 * on_soil.pressure:.2f} kPa" in printed
    assert f"{1e3 * on_soil.sinkage:.2f} mm" in printed
    assert f"slip straight ahead under this load: {on_soil.slip():.4f}" in printed

    # the row of the curve's state at a slip of a fifth
    k = np.abs(curve.slip - 0.2).argmin()
    (row,) = (line.split() for line in printed.splitlines() if line.split()[:1] == ["0.20"])
    assert row[1:] == [
        f"{curve.thrust[k]:.1f}",
        f"{curve.resistance[k]:.1f}",
        f"{curve.pull[k]:.1f}",
        f"{curve.pull[k] / weight:.3f}",
        f"{curve.efficiency[k]:.2f}",
        f"{1e3 * curve.sinkage[k]:.1f}",
        f"{np.degrees(curve.pitch[k]):.1f}°".replace("-", "−"),
    ]


def test_theory_knows_two_axles_and_slopes_straight_up():
    axles = (-0.2, 0.0, 0.2)
    three = {"contact": "wheels", "axles": axles, "patch_length": 0.05, "sprocket_radius": 0.08}
    with pytest.raises(InvalidValueError, match=r"axles = .*: must be two on soft soil"):
        OnSoil(type(SHIPPED)(**three), LOAM, Load())
    with pytest.raises(InvalidValueError, match=r"uphill = 0\.1: must be 0 on soft soil"):
        OnSoil(HUSKY, LOAM, Load(slope=0.1, uphill=0.1))
