import numpy as np
import pytest
from scipy.optimize import brentq

from trackslip.errors import InvalidValueError
from trackslip.skid_theory import line_contact, steady_twist

B, L = 0.168, 0.17


def icr_half_width(speeds, contact):
    twist = steady_twist(speeds, contact)
    return (speeds[..., 1] - speeds[..., 0]) / (2 * twist[..., 2])


def closed_form_offset(ratio):
    """D of a uniformly loaded line, from b F_along(D) = M_across(D), both integrals done by hand."""

    def balance(d):
        scaled = d / ratio  # (mu_along D)^2 + (mu_across x)^2 = mu_across^2 (scaled^2 + x^2)
        reach = np.hypot(L, scaled)
        area = np.arcsinh(L / scaled)
        return B * d / ratio**2 * area - (L * reach - scaled**2 * area) / 2

    return brentq(balance, 1e-6, 2.0, xtol=1e-14)


@pytest.mark.parametrize("ratio", [0.7, 1.0, 1.107, 1.4, 2.0])
def test_icr_of_a_uniform_track_is_the_closed_form(ratio):
    speeds = np.array([[0.1, 0.14], [0.0, 0.1], [-0.1, 0.1], [0.2, 0.21]])
    half_width = icr_half_width(speeds, line_contact(B, L, 0.7, 0.7 * ratio, points=2000))
    np.testing.assert_allclose(half_width, B + closed_form_offset(ratio), rtol=1e-5)


@pytest.mark.parametrize("gravity", [np.inf, 9.81, 0.5])
@pytest.mark.parametrize("centre_of_mass", [(0.0, 0.0, 0.0), (0.02, 0.01, 0.12), (-0.03, -0.02, 0.2)])
def test_ground_forces_carry_weight_and_momentum(centre_of_mass, gravity):
    """Newton and Euler for a robot of unit weight, written out from the twist alone."""
    contact = line_contact(B, L, 0.6, 0.8, centre_of_mass)
    surface = np.array([0.1, 0.16])
    v, u, w = steady_twist(surface, contact, gravity)
    forwards, left, height = centre_of_mass
    a_x, a_y = -w * (u + w * forwards) / gravity, w * (v - w * left) / gravity
    load = contact.loads(np.array([a_x, a_y]))
    belt = np.where(contact.y > 0, surface[0], surface[1])
    slide_x, slide_y = v - w * contact.y - belt, u + w * contact.x
    size = np.hypot(contact.along * slide_x, contact.across * slide_y)
    force_x = -load * contact.along**2 * slide_x / size
    force_y = -load * contact.across**2 * slide_y / size
    x, y = contact.x - forwards, contact.y - left  # from the centre of mass
    np.testing.assert_allclose([force_x.sum(), force_y.sum(), load.sum()], [a_x, a_y, 1.0], atol=1e-6)
    np.testing.assert_allclose(np.sum(x * force_y - y * force_x), 0, atol=1e-6)  # yaw
    np.testing.assert_allclose([np.sum(y * load), np.sum(x * load)], [-height * a_y, -height * a_x], atol=1e-6)


def test_inertia_matters_little_at_these_speeds_and_much_at_great_ones():
    slow, fast = (np.array([0.1, 0.15]) * k for k in (1, 20))
    contact = line_contact(B, L, 0.7, 0.8, (0.0, 0.0, 0.12))
    quasi_static = icr_half_width(slow, contact)
    with_inertia = [(s[1] - s[0]) / (2 * steady_twist(s, contact, 9.81)[2]) for s in (slow, fast)]
    assert with_inertia[0] == pytest.approx(quasi_static, rel=1e-3)
    assert abs(with_inertia[1] / quasi_static - 1) > 0.05


def test_slip_depends_on_neither_speed_nor_size_of_friction():
    speeds = np.array([0.1, 0.15])
    twist = steady_twist(speeds, line_contact(B, L, 0.7, 0.8))
    np.testing.assert_allclose(steady_twist(3 * speeds, line_contact(B, L, 0.7, 0.8)), 3 * twist, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(steady_twist(speeds, line_contact(B, L, 0.35, 0.4)), twist, rtol=1e-6, atol=1e-9)


def test_turns_mirror_and_straight_is_straight():
    contact = line_contact(B, L, 0.7, 0.8)
    left, right = steady_twist(np.array([[0.1, 0.15], [0.15, 0.1]]), contact)
    np.testing.assert_allclose(right, left * [1, -1, -1], atol=1e-9)
    np.testing.assert_allclose(steady_twist([0.2, 0.2], contact), [0.2, 0, 0], atol=1e-9)
    np.testing.assert_allclose(steady_twist([0.0, 0.0], contact), 0)


def test_impossible_contacts_are_refused():
    with pytest.raises(InvalidValueError, match="along"):
        line_contact(B, L, -0.7, 0.8)
    with pytest.raises(InvalidValueError, match="centre_of_mass"):
        line_contact(B, L, 0.7, 0.8, centre_of_mass=(0.2, 0.0, 0.1))
    with pytest.raises(InvalidValueError, match="surface_speeds"):
        steady_twist([np.nan, 0.1], line_contact(B, L, 0.7, 0.8))
