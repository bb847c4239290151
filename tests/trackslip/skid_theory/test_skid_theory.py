import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from trackslip.skid_theory import Load, line_contact, steady_twist, wheel_contact
from trackslip.skid_theory.contact import displacement, ground_wrench

B, L = 0.168, 0.17
LEVEL = line_contact(B, L, 0.7, 0.778)
HIGH = line_contact(B, L, 0.7, 0.778, (0.0, 0.0, 0.12))
MIRROR = [1, -1, -1]


def offset(speeds, contact=LEVEL, **options):
    speeds = np.asarray(speeds, float)
    return (speeds[..., 1] - speeds[..., 0]) / (
        2 * steady_twist(speeds, contact, **options)[..., 2]
    ) - B


def closed_form_offset(ratio):
    """D of a uniformly loaded line, from b F_along(D) = M_across(D), both integrals done by
    hand.
    """

    def balance(d):
        scaled = d / ratio  # (mu_along D)^2 + (mu_across x)^2 = mu_across^2 (scaled^2 + x^2)
        reach = np.hypot(L, scaled)
        area = np.arcsinh(L / scaled)
        return B * d / ratio**2 * area - (L * reach - scaled**2 * area) / 2

    return brentq(balance, 1e-6, 2.0, xtol=1e-14)


@pytest.mark.parametrize("ratio", [0.7, 1.107, 2.0])
def test_icr_of_a_uniform_track_is_the_closed_form(ratio):
    speeds = np.array([[0.1, 0.14], [0.0, 0.1], [-0.1, 0.1], [0.2, 0.21]])
    found = offset(speeds, line_contact(B, L, 0.7, 0.7 * ratio, points=2000))
    np.testing.assert_allclose(B + found, B + closed_form_offset(ratio), rtol=1e-5)


@pytest.mark.parametrize("shear", [1e-4, 0.01])
@pytest.mark.parametrize("pull", [-0.3, 0.05, 0.6])
def test_straight_ahead_is_the_closed_form(shear, pull):
    """Of Janosi and Hanamoto: the mean of the shares of all elements of a track."""
    v, u, w = steady_twist(
        [0.2, 0.2], line_contact(B, L, 0.7, 0.778, points=400), shear=shear, load=Load(pull=pull)
    )
    slip = 1 - v / 0.2
    assert np.sign(slip) == np.sign(pull)
    ratio = abs(slip) * 2 * L / shear
    closed = 0.7 * (1 - (1 - np.exp(-ratio)) / ratio)
    # the points must resolve the entry
    assert closed == pytest.approx(abs(pull), rel=2e-3 if shear < 1e-3 else 2e-5)
    np.testing.assert_allclose([u, w], 0, atol=1e-9)


def test_firm_ground_is_coulomb_ground():
    speeds = [[0.1, 0.14], [-0.1, 0.1], [0.0, 0.1], [-0.14, -0.1], [0.1, 0.1]]
    load = Load(slope=0.1, uphill=0.4, pull=0.05, hitch_height=0.1)
    coulomb, firm = (steady_twist(speeds, HIGH, shear=shear, load=load) for shear in (0.0, 1e-6))
    np.testing.assert_allclose(firm, coulomb, atol=2e-5 * 0.14 / 0.2)


@pytest.mark.parametrize("belt", [0.2, -0.2])
@pytest.mark.parametrize("twist", [(0.15, 0.02, 0.9), (0.1, -0.01, -0.3), (-0.15, 0.0, 1e-9)])
def test_displacements_are_those_of_elements_followed(twist, belt):
    contact = line_contact(B, L, 0.7, 0.778, points=4)
    found = displacement(np.array(twist), np.full(8, belt), contact)
    v, u, w = twist
    entry = L if belt > 0 else -L
    for k in range(8):
        y = contact.y[k]

        def velocity(t, state, y=y):  # of an element in the world, and of where it is on the robot
            phi, x = state[2], state[3]
            cos, sin = np.cos(phi), np.sin(phi)
            slide, aside = v - w * y - belt, u + w * x
            return [cos * slide - sin * aside, sin * slide + cos * aside, w, -belt]

        time = (entry - contact.x[k]) / belt
        x, y_moved, phi, _ = solve_ivp(
            velocity, (0, time), [0, 0, 0, entry], rtol=1e-10, atol=1e-12
        ).y[:, -1]
        cos, sin = np.cos(phi), np.sin(phi)
        np.testing.assert_allclose(
            found[k], [cos * x + sin * y_moved, cos * y_moved - sin * x], atol=1e-9
        )


@pytest.mark.parametrize("shear", [0.0, 0.01])
@pytest.mark.parametrize("speeds", [[0.1, 0.16], [-0.1, 0.1], [0.0, 0.1], [-0.16, -0.1]])
def test_the_ground_carries_weight_momentum_slope_and_pull(speeds, shear):
    """Newton and Euler for a robot of unit weight on a slope, with a drawbar, written out from the
    twist alone.
    """
    centre = forwards, left, height = 0.02, 0.01, 0.12
    contact, load = line_contact(B, L, 0.6, 0.8, centre), Load(0.15, 0.7, 0.08, 0.1)
    speeds = 3 * np.array(speeds)
    v, u, w = twist = steady_twist(speeds, contact, 9.81, shear=shear, load=load)
    normal = np.cos(load.slope)
    need = np.array([-w * (u + w * forwards), w * (v - w * left)]) / 9.81 / normal
    # at the centre of mass
    need += np.tan(load.slope) * np.array([np.cos(load.uphill), np.sin(load.uphill)])
    drawbar = load.pull / normal
    belt = np.where(contact.y > 0, speeds[0], speeds[1])
    loads = contact.loads(need, load.hitch_height * drawbar)
    assert loads.sum() == pytest.approx(1)
    assert (contact.x * loads).sum() == pytest.approx(
        forwards - height * need[0] - load.hitch_height * drawbar
    )
    assert (contact.y * loads).sum() == pytest.approx(left - height * need[1])
    found = ground_wrench(twist, belt, contact, loads, shear or 1e-9)
    moment = forwards * need[1] - left * need[0]
    # friction of elements that pivot, which Coulomb ground has in full
    fades = 1e-6 if shear else 2e-5
    np.testing.assert_allclose(found, [need[0] + drawbar, need[1], moment], atol=fades)


def test_turns_mirror_left_and_right_and_front_and_back():
    load = Load(0.1, 0.5, 0.05, 0.1)
    left = steady_twist([0.1, 0.15], HIGH, shear=0.01, load=load)
    right = steady_twist([0.15, 0.1], HIGH, shear=0.01, load=Load(0.1, -0.5, 0.05, 0.1))
    np.testing.assert_allclose(right, left * MIRROR, atol=1e-9)
    ahead, back = steady_twist([[0.1, 0.15], [-0.1, -0.15]], LEVEL, shear=0.01)
    np.testing.assert_allclose(back, ahead * [-1, 1, -1], atol=1e-9)


@pytest.mark.parametrize("ratio", [0.7, 1.5])
@pytest.mark.parametrize("half_wheelbase", [0.05, 0.4])
def test_the_yaw_ratio_of_four_wheels_on_points(half_wheelbase, ratio):
    """Moments of four alike points balance where D = (ratio a)^2 / b, at half the wheelbase a."""
    contact = wheel_contact(B, (-half_wheelbase, half_wheelbase), 1e-6, 0.7, 0.7 * ratio, points=2)
    yaw_rate = steady_twist([[-0.1, 0.1], [0.1, 0.3]], contact)[:, 2]
    np.testing.assert_allclose(
        yaw_rate * B / 0.1, 1 / (1 + (ratio * half_wheelbase / B) ** 2), rtol=1e-4
    )
