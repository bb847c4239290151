from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import gamma

from trackslip.errors import InvalidValueError
from trackslip.skid_theory import Soil, Tracks, Wheels, drawbar_curve, most_slope, roll, slip_for
from trackslip.skid_theory.soil import stand

SAND = Soil(990.0, 1.528e6, n=1.1, cohesion=1040.0, friction_angle=np.radians(28.0), shear=0.025)
SNOW = Soil(4370.0, 1.97e5, n=1.6, cohesion=1030.0, friction_angle=np.radians(19.7), shear=0.04)
LOOSE = replace(SAND, cohesion=0.0)
DIGGING = replace(SAND, n1=0.4)
RIGID = replace(SAND, k_phi=1e15)
WIDTH = 0.08
TRACKS = Tracks(length=0.34, width=WIDTH, weight=245.25, com_height=0.12)
LOW = replace(TRACKS, com_height=0.0)
SLIP = np.array([0.02, 0.2, 1.0])


def janosi_and_hanamoto(soil, tracks, slip):
    ratio = slip * tracks.length / soil.shear
    strength = tracks.area * soil.cohesion + tracks.weight * np.tan(soil.friction_angle)
    return strength * (1 - (1 - np.exp(-ratio)) / ratio)


@pytest.mark.parametrize("soil", [SAND, SNOW, DIGGING])
def test_sinkage_is_the_inverse_of_pressure(soil):
    depth = np.array([1e-4, 0.005, 0.3])
    np.testing.assert_allclose(soil.sinkage(soil.pressure(depth, WIDTH, SLIP), WIDTH, SLIP), depth)


def test_sinkage_of_the_shipped_robot_is_bekkers():
    """By hand: 4508 Pa / (0.99 / 0.08 + 1528) kPa = 0.0029269, to the power of 1 / 1.1."""
    assert SAND.sinkage(TRACKS.pressure, WIDTH) == pytest.approx(4.974e-3, rel=1e-4)


def test_work_is_the_integral_of_pressure_over_depth():
    for slip in (0.0, 0.5):
        by_hand, _ = quad(lambda z, i=slip: float(DIGGING.pressure(z, WIDTH, i)), 0.0, 0.02)
        assert DIGGING.work(0.02, WIDTH, slip) == pytest.approx(by_hand, rel=1e-6)


def test_resistance_is_bekkers_formula():
    """R_c = b / (n + 1) / k^(1/n) p^((n + 1) / n) for each of two tracks."""
    n = SAND.n
    modulus = SAND.k_c / WIDTH + SAND.k_phi
    expected = 2 * WIDTH / (n + 1) / modulus ** (1 / n) * TRACKS.pressure ** ((n + 1) / n)
    curve = drawbar_curve(SAND, TRACKS, SLIP)
    np.testing.assert_allclose(curve.resistance, expected, rtol=1e-9)


def test_bulldozing_is_rankines_pressure_over_the_depth():
    passive = np.tan(np.pi / 4 + SAND.friction_angle / 2) ** 2

    def pressure(z):
        return SAND.unit_weight * z * passive + 2 * SAND.cohesion * np.sqrt(passive)

    assert SAND.bulldozing(0.03) == pytest.approx(quad(pressure, 0.0, 0.03)[0], rel=1e-9)


@pytest.mark.parametrize("soil", [SAND, LOOSE, SNOW])
def test_thrust_is_that_of_janosi_and_hanamoto(soil):
    curve = drawbar_curve(soil, LOW, SLIP)
    np.testing.assert_allclose(curve.thrust, janosi_and_hanamoto(soil, LOW, SLIP), rtol=1e-9)
    np.testing.assert_allclose(curve.pull, curve.thrust - curve.resistance)


def test_thrust_of_little_slip_grows_with_the_length_of_contact():
    """F = F_max i L / (2 K)."""
    slip = 1e-6
    assert SAND.mobilised(slip, 0.34) == pytest.approx(slip * 0.34 / (2 * SAND.shear), rel=1e-4)
    assert SAND.mobilised(-slip, 0.34) == -SAND.mobilised(slip, 0.34)
    assert SAND.mobilised(0.0, 0.34) == 0.0


def test_friction_is_the_strength_over_the_pressure():
    along, across = SAND.friction(TRACKS.pressure, 0.005, WIDTH)
    strength = SAND.cohesion + TRACKS.pressure * np.tan(SAND.friction_angle)
    assert along * TRACKS.pressure == pytest.approx(strength)
    sideways = (across - along) * TRACKS.pressure * WIDTH
    assert sideways == pytest.approx(float(SAND.bulldozing(0.005)))


def test_thrust_without_cohesion_is_proportional_to_the_weight():
    heavy = replace(LOW, weight=10 * LOW.weight)
    ratio = drawbar_curve(LOOSE, heavy, SLIP).thrust / drawbar_curve(LOOSE, LOW, SLIP).thrust
    np.testing.assert_allclose(ratio, 10.0)


def test_rigid_soil_neither_sinks_nor_resists():
    curve = drawbar_curve(RIGID, TRACKS, SLIP, hitch_height=0.1)
    np.testing.assert_allclose(curve.sinkage, 0.0, atol=1e-9)
    np.testing.assert_allclose(curve.resistance, 0.0, atol=1e-6)


def test_soil_without_an_exponent_yields_at_one_pressure():
    """n -> 0: nothing below the pressure k, everything above it."""
    plastic = replace(SAND, n=0.0)
    bearing = plastic.modulus(WIDTH)
    assert plastic.sinkage(0.99 * bearing, WIDTH) == 0.0
    assert plastic.sinkage(1.01 * bearing, WIDTH) == np.inf
    nearly = replace(SAND, n=1e-3)
    assert nearly.sinkage(0.9 * nearly.modulus(WIDTH), WIDTH) < 1e-40


@pytest.mark.parametrize("soil", [SAND, SNOW])
@pytest.mark.parametrize("settlement", [0.0, 0.002])
@pytest.mark.parametrize("arm", [-0.14, -0.06, -0.02, 0.0, 0.02, 0.1])
def test_pressures_carry_the_weight_at_its_centre(soil, settlement, arm):
    tracks = replace(TRACKS, settlement=settlement)
    standing = stand(soil, tracks, 0.1, tracks.weight, arm)
    x = tracks.length * ((np.arange(100) + 0.5) / 100 - 0.5)
    force = 2 * tracks.width * tracks.length / 100 * standing.pressure[0]
    assert force.sum() == pytest.approx(tracks.weight, rel=2e-3)
    assert (force * x).sum() / force.sum() == pytest.approx(arm, abs=2e-4)


def test_a_lifted_front_leaves_the_contact_of_the_closed_form():
    """With p as z^n from 0 at the entry, the centre is 1 / (n + 2) of the contact from the rear."""
    arm = -0.13
    standing = stand(SAND, TRACKS, 0.0, TRACKS.weight, arm)
    contact = float(standing.entry[0]) + TRACKS.length / 2
    assert contact == pytest.approx((SAND.n + 2) * (TRACKS.length / 2 + arm), rel=2e-3)
    # the depth at the rear: mean pressure over the contact is 1 / (n + 1) of that at the rear
    most = TRACKS.weight / (2 * WIDTH * contact) * (SAND.n + 1)
    assert standing.rut[0] == pytest.approx(float(SAND.sinkage(most, WIDTH)), rel=2e-3)


def test_a_front_that_is_deeper_leaves_its_rut_to_the_rest():
    standing = stand(SAND, TRACKS, 0.0, TRACKS.weight, 0.02)
    front = TRACKS.pressure * (1 + 6 * 0.02 / TRACKS.length)
    assert standing.rut[0] == pytest.approx(float(SAND.sinkage(front, WIDTH)), rel=1e-9)
    assert standing.rear[0] == standing.front[0]  # on its floor


@pytest.mark.slow
def test_springs_on_rigid_soil_pitch_as_springs_do():
    """The load changes by 12 x_p / L over the track, as the settlement does; the pitch moves the
    centre of mass, and thus x_p, by its height.
    """
    tracks = replace(TRACKS, settlement=0.002)
    pull = 0.1 * TRACKS.weight
    slip = slip_for(RIGID, tracks, pull, hitch_height=0.1)
    curve = drawbar_curve(RIGID, tracks, slip, hitch_height=0.1)
    assert curve.pull[0] == pytest.approx(pull, rel=1e-6)
    softness = 12 / tracks.length**2 * 0.002  # pitch per distance of the centre of pressure
    expected = softness * 0.1 * 0.1 / (1 - softness * tracks.com_height)
    assert curve.pitch[0] == pytest.approx(expected, rel=2e-3)


def test_slip_digs_a_track_in():
    """By (1), z = (p / k)^(1 / (n + n_1 i))."""
    curve = drawbar_curve(DIGGING, LOW, SLIP)
    relative = TRACKS.pressure / DIGGING.modulus(WIDTH)
    np.testing.assert_allclose(curve.sinkage, relative ** (1 / (1.1 + 0.4 * SLIP)), rtol=1e-9)


def test_without_slip_sinkage_the_most_pull_is_at_full_slip():
    curve = drawbar_curve(SAND, LOW)
    assert curve.slip[curve.most] == 1.0
    assert slip_for(SAND, LOW, 0.999 * curve.pull[-1]) == pytest.approx(1.0, abs=0.05)


def test_a_robot_that_digs_itself_in_is_immobilised():
    curve = drawbar_curve(DIGGING, TRACKS, hitch_height=0.1)
    most = curve.pull[curve.most]
    assert curve.slip[curve.most] < 0.8
    assert curve.pull[-1] < 0.99 * most
    slip = slip_for(DIGGING, TRACKS, 0.99 * most, hitch_height=0.1)
    assert slip < curve.slip[curve.most]
    assert np.isnan(slip_for(DIGGING, TRACKS, 1.01 * most, hitch_height=0.1))


def test_efficiency_is_the_power_of_the_pull_over_the_belts():
    curve = drawbar_curve(SAND, LOW)
    power = curve.thrust * np.cos(curve.pitch)
    np.testing.assert_allclose(curve.efficiency, curve.pull * (1 - curve.slip) / power)
    assert curve.efficiency[curve.best] == np.nanmax(curve.efficiency)
    # at full slip nothing moves, and at little slip all thrust is spent on the resistance
    assert curve.efficiency[-1] == 0.0
    assert curve.efficiency[0] < curve.efficiency[curve.best]


def test_steepest_slope_of_dry_firm_ground_is_its_friction_angle():
    dry = replace(RIGID, cohesion=0.0, shear=1e-5)
    assert most_slope(dry, LOW) == pytest.approx(dry.friction_angle, abs=1e-4)
    # a shear modulus takes the share of (3) at full slip from it
    soft = replace(dry, shear=0.025)
    share = float(soft.mobilised(1.0, LOW.length))
    expected = np.arctan(share * np.tan(dry.friction_angle))
    assert most_slope(soft, LOW) == pytest.approx(expected, abs=1e-4)


def test_a_high_hitch_tips_the_robot_over():
    firm = replace(RIGID, shear=1e-4)
    curve = drawbar_curve(firm, TRACKS, [1e-5, 1.0], hitch_height=0.5)
    assert np.isfinite(curve.pull[0])
    assert np.isnan(curve.pull[1])


@pytest.mark.parametrize(
    ("call", "field"),
    [
        (lambda: Soil(0.0, 0.0), "k_c, k_phi"),
        (lambda: replace(SAND, n=-0.1), "n"),
        (lambda: replace(SAND, shear=0.0), "shear"),
        (lambda: replace(SAND, cohesion=0.0, friction_angle=0.0), "friction_angle"),
        (lambda: replace(SAND, assumed=("colour",)), "assumed"),
        (lambda: replace(TRACKS, width=0.0), "width"),
        (lambda: replace(TRACKS, com_x=0.2), "com_x"),
        (lambda: replace(TRACKS, settlement=-1e-3), "settlement"),
        (lambda: replace(HUSKY, length=0.0), "length"),
        (lambda: replace(HUSKY, radius=-0.1), "radius"),
        (lambda: replace(HUSKY, width=np.inf), "width"),
        (lambda: replace(HUSKY, weight=0.0), "weight"),
        (lambda: replace(HUSKY, settlement=-1e-3), "settlement"),
        (lambda: replace(HUSKY, com_height=np.nan), "com_height"),
        (lambda: replace(HUSKY, com_x=0.257), "com_x"),
        (lambda: replace(HUSKY, com_x=-0.257), "com_x"),
        (lambda: drawbar_curve(SAND, TRACKS, [0.0, 0.1]), "slip"),
        (lambda: drawbar_curve(SAND, TRACKS, slope=-0.1), "slope"),
    ],
)
def test_values_out_of_range_are_refused_by_name(call, field):
    with pytest.raises(InvalidValueError) as refused:
        call()
    assert refused.value.field == field


def test_centres_of_mass_may_lie_up_to_an_axle_or_an_end():
    for gear in (TRACKS, HUSKY):
        for com_x in (-gear.length / 2, gear.length / 2):
            assert replace(gear, com_x=com_x, settlement=0.0).com_x == com_x


HUSKY = Wheels(length=0.512, radius=0.165, width=0.1143, weight=75 * 9.81, com_height=0.25)
LARGE = replace(HUSKY, radius=20.0)


@pytest.mark.parametrize("n", [0.0, 0.5, 1.0, 1.6])
def test_the_load_of_a_large_wheel_is_bekkers_integral(n):
    """For an arc that is a parabola."""
    soil = replace(SAND, n=n)
    depth = 0.01
    chord = np.sqrt(2 * LARGE.radius * depth)
    shape = np.sqrt(np.pi) / 2 * gamma(n + 1) / gamma(n + 1.5)
    load = LARGE.width * soil.modulus(LARGE.width) * depth**n * chord * shape
    rolling = roll(soil, LARGE, load)
    assert rolling.rut[0] == pytest.approx(depth, rel=1e-3)
    expected = LARGE.width * soil.work(depth, LARGE.width)
    assert rolling.resistance[0] == pytest.approx(expected, rel=3e-3)
    assert rolling.load[0] == pytest.approx(load)
    if n in (0.0, 1.0):
        assert shape == pytest.approx((3 - n) / 3)


def test_sinkage_of_a_wheel_by_hand():
    """Bekker's z^(n + 1/2) = 3 W / ((3 - n) b k sqrt(D)), here with sqrt(D) by the arc."""
    load = 184.0
    modulus = SAND.modulus(HUSKY.width)
    width = HUSKY.width * np.sqrt(2 * HUSKY.radius)
    bekker = (3 * load / ((3 - SAND.n) * width * modulus)) ** (1 / (SAND.n + 0.5))
    assert roll(SAND, HUSKY, load).rut[0] == pytest.approx(bekker, rel=0.02)


def test_a_wheel_in_a_rut_bears_what_the_rest_of_its_arc_bears():
    first = roll(SAND, HUSKY, 184.0)
    second = roll(SAND, HUSKY, 184.0, first.rut)

    def pressure(x):
        arc = second.rut - HUSKY.radius + np.sqrt(HUSKY.radius**2 - x**2)
        return float(SAND.pressure(arc, HUSKY.width)[0])

    by_hand, _ = quad(pressure, 0.0, float(second.entry[0]))
    assert HUSKY.width * by_hand == pytest.approx(184.0, rel=1e-4)
    assert 0 < second.resistance < first.resistance
    deeper = SAND.work(second.rut, HUSKY.width) - SAND.work(first.rut, HUSKY.width)
    np.testing.assert_allclose(second.resistance, HUSKY.width * deeper)


def test_each_pass_deepens_a_rut_by_less():
    ruts = [0.0]
    for _ in range(6):
        ruts.append(float(roll(SAND, HUSKY, 184.0, ruts[-1]).rut[0]))
    growth = np.diff(ruts)
    assert (growth > 0).all()
    assert (np.diff(growth) < 0).all()


def test_resistance_of_a_wheel_is_the_push_of_its_rim():
    """The horizontal part of pressures that are normal to the rim."""
    rolling = roll(SAND, HUSKY, 184.0)
    x = rolling.entry[:, None] - rolling.behind
    steepness = x / np.sqrt(HUSKY.radius**2 - x**2)
    push = HUSKY.width * rolling.entry * (rolling.pressure * steepness).mean(axis=1)
    np.testing.assert_allclose(push, rolling.resistance, rtol=1e-3)


def test_thrust_of_a_wheel_at_full_slip_is_the_strength():
    rolling = roll(SAND, HUSKY, 184.0)
    area = HUSKY.width * rolling.entry[0]
    strength = area * SAND.cohesion + 184.0 * np.tan(SAND.friction_angle)
    stiff = replace(SAND, shear=1e-5)
    assert rolling.thrust(stiff, np.ones(1))[0] == pytest.approx(strength)
    np.testing.assert_allclose(rolling.thrust(SAND, -SLIP[2:]), -rolling.thrust(SAND, SLIP[2:]))


def test_thrust_at_little_slip_grows_with_the_sheared_length():
    """For n = 1 and no cohesion, the mean distance behind the entry is 5/8 of the arc."""
    soil = replace(LOOSE, n=1.0)
    rolling = roll(soil, LARGE, 1e3)
    mean = 5 / 8 * rolling.entry[0]
    slip = np.full(1, 1e-6)
    expected = 1e3 * np.tan(soil.friction_angle) * slip * mean / soil.shear
    np.testing.assert_allclose(rolling.thrust(soil, slip), expected, rtol=1e-3)


def test_wheels_balance_moments_of_pull_weight_and_resistance():
    curve = drawbar_curve(SAND, HUSKY, SLIP, hitch_height=0.2)
    lean = HUSKY.com_height * np.sin(curve.pitch)
    moment = 0.2 * np.maximum(curve.pull, 0.0) + HUSKY.radius * curve.resistance
    arm = -lean - moment / HUSKY.weight
    front = HUSKY.weight * (0.5 + arm / HUSKY.length) / 2
    first = roll(SAND, HUSKY, front, 0.0, SLIP)
    second = roll(SAND, HUSKY, HUSKY.weight / 2 - front, first.rut, SLIP)
    np.testing.assert_allclose(curve.sinkage, second.rut, rtol=1e-6)
    resistance = 2 * (first.resistance + second.resistance)
    np.testing.assert_allclose(curve.resistance, resistance, rtol=1e-6)
    np.testing.assert_allclose(np.tan(curve.pitch), (second.rut - first.rut) / HUSKY.length)


def test_wheels_climb_less_than_the_friction_angle():
    steepest = most_slope(LOOSE, HUSKY)
    assert np.radians(5.0) < steepest < LOOSE.friction_angle
    assert slip_for(LOOSE, HUSKY, slope=0.9 * steepest) < 1.0
    assert np.isnan(slip_for(LOOSE, HUSKY, slope=1.1 * steepest))
