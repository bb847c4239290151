import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from trackslip.skid_theory import Load, line_contact, steady_twist, wheel_contact
from trackslip.skid_theory.contact import displacement, ground_wrench

B = 0.168  # half of the gauge [m]
L = 0.17  # half of the contact's length [m]
LEVEL = line_contact(B, L, 0.7, 0.778)
HIGH = line_contact(B, L, 0.7, 0.778, (0.0, 0.0, 0.12))
MIRROR = [1, -1, -1]


def offset(speeds, contact=LEVEL):
    """D (...) of steady turns at belt speeds (..., 2) [m]."""
    left, right = np.moveaxis(np.asarray(speeds, float), -1, 0)
    yaw_rate = steady_twist(speeds, contact)[..., 2]
    return (right - left) / (2 * yaw_rate) - B


def closed_form_offset(ratio):
    """D of a uniformly loaded line, from b F_along(D) = M_across(D), both integrals done by
    hand.

    With (mu_along D)^2 + (mu_across x)^2 = mu_across^2 (scaled^2 + x^2), scaled = D / ratio, the
    integrals over x from 0 to L are, up to a common factor,

        F_along  = D / ratio^2 arcsinh(L / scaled)
        M_across = (L sqrt(L^2 + scaled^2) - scaled^2 arcsinh(L / scaled)) / 2
    """

    def balance(d):
        scaled = d / ratio
        reach = np.hypot(L, scaled)
        area = np.arcsinh(L / scaled)
        force_along = d / ratio**2 * area
        moment_across = (L * reach - scaled**2 * area) / 2
        return B * force_along - moment_across

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
    contact = line_contact(B, L, 0.7, 0.778, points=400)
    v, u, w = steady_twist([0.2, 0.2], contact, shear=shear, load=Load(pull=pull))
    slip = 1 - v / 0.2
    assert np.sign(slip) == np.sign(pull)
    ratio = abs(slip) * 2 * L / shear
    traction = 0.7 * (1 - (1 - np.exp(-ratio)) / ratio)
    tolerance = 2e-3 if shear < 1e-3 else 2e-5  # the points must resolve the entry
    assert traction == pytest.approx(abs(pull), rel=tolerance)
    np.testing.assert_allclose([u, w], 0, atol=1e-9)


def test_firm_ground_is_coulomb_ground():
    speeds = [[0.1, 0.14], [-0.1, 0.1], [0.0, 0.1], [-0.14, -0.1], [0.1, 0.1]]
    load = Load(slope=0.1, uphill=0.4, pull=0.05, hitch_height=0.1)
    coulomb = steady_twist(speeds, HIGH, shear=0.0, load=load)
    firm = steady_twist(speeds, HIGH, shear=1e-6, load=load)
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

        def velocity(t, state, y=y):
            """Of an element's place in the world, of the robot's heading and of the element's x
            on the robot.
            """
            _, _, phi, x = state
            cos = np.cos(phi)
            sin = np.sin(phi)
            slide = v - w * y - belt
            aside = u + w * x
            return [cos * slide - sin * aside, sin * slide + cos * aside, w, -belt]

        time = (entry - contact.x[k]) / belt
        start = [0, 0, 0, entry]
        path = solve_ivp(velocity, (0, time), start, rtol=1e-10, atol=1e-12)
        world_x, world_y, phi, _ = path.y[:, -1]
        cos = np.cos(phi)
        sin = np.sin(phi)
        on_the_robot = [cos * world_x + sin * world_y, cos * world_y - sin * world_x]
        np.testing.assert_allclose(found[k], on_the_robot, atol=1e-9)


@pytest.mark.parametrize("shear", [0.0, 0.01])
@pytest.mark.parametrize("speeds", [[0.1, 0.16], [-0.1, 0.1], [0.0, 0.1], [-0.16, -0.1]])
def test_the_ground_carries_weight_momentum_slope_and_pull(speeds, shear):
    """Newton and Euler for a robot of unit weight on a slope, with a drawbar, written out from the
    twist alone.
    """
    centre = forwards, left, height = 0.02, 0.01, 0.12
    contact = line_contact(B, L, 0.6, 0.8, centre)
    load = Load(slope=0.15, uphill=0.7, pull=0.08, hitch_height=0.1)
    speeds = 3 * np.array(speeds)
    v, u, w = twist = steady_twist(speeds, contact, 9.81, shear=shear, load=load)

    # at the centre of mass, over the weight's normal part
    normal = np.cos(load.slope)
    momentum = np.array([-w * (u + w * forwards), w * (v - w * left)]) / 9.81 / normal
    uphill = np.array([np.cos(load.uphill), np.sin(load.uphill)])
    need = momentum + np.tan(load.slope) * uphill
    drawbar = load.pull / normal
    hitch_moment = load.hitch_height * drawbar

    loads = contact.loads(need, hitch_moment)
    moment_about_y = forwards - height * need[0] - hitch_moment
    moment_about_x = left - height * need[1]
    assert loads.sum() == pytest.approx(1)
    assert (contact.x * loads).sum() == pytest.approx(moment_about_y)
    assert (contact.y * loads).sum() == pytest.approx(moment_about_x)
    belt = np.where(contact.y > 0, speeds[0], speeds[1])
    found = ground_wrench(twist, belt, contact, loads, shear or 1e-9)
    moment = forwards * need[1] - left * need[0]
    # friction of elements that pivot, which Coulomb ground has in full
    fades = 1e-6 if shear else 2e-5
    np.testing.assert_allclose(found, [need[0] + drawbar, need[1], moment], atol=fades)


def test_turns_mirror_left_and_right_and_front_and_back():
    to_the_left = Load(slope=0.1, uphill=0.5, pull=0.05, hitch_height=0.1)
    to_the_right = Load(slope=0.1, uphill=-0.5, pull=0.05, hitch_height=0.1)
    left = steady_twist([0.1, 0.15], HIGH, shear=0.01, load=to_the_left)
    right = steady_twist([0.15, 0.1], HIGH, shear=0.01, load=to_the_right)
    np.testing.assert_allclose(right, left * MIRROR, atol=1e-9)
    ahead, back = steady_twist([[0.1, 0.15], [-0.1, -0.15]], LEVEL, shear=0.01)
    np.testing.assert_allclose(back, ahead * [-1, 1, -1], atol=1e-9)


@pytest.mark.parametrize("ratio", [0.7, 1.5])
@pytest.mark.parametrize("half_wheelbase", [0.05, 0.4])
def test_the_yaw_ratio_of_four_wheels_on_points(half_wheelbase, ratio):
    """Moments of four alike points balance where D = (ratio a)^2 / b, at half the wheelbase a."""
    contact = wheel_contact(B, (-half_wheelbase, half_wheelbase), 1e-6, 0.7, 0.7 * ratio, points=2)
    yaw_rate = steady_twist([[-0.1, 0.1], [0.1, 0.3]], contact)[:, 2]
    without_slip = 0.1 / B
    expected = 1 / (1 + (ratio * half_wheelbase / B) ** 2)
    np.testing.assert_allclose(yaw_rate / without_slip, expected, rtol=1e-4)
