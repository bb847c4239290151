"""The looks of a track: the belt's way around its wheels, and what moves with it."""

import numpy as np
import pytest

from sim.tracks.hull import Hull, Outline
from sim.tracks.looks import BOX, CYLINDER, TrackLook

TWO = [(-0.22, 0.08, 0.08), (0.22, 0.08, 0.08)]
TAPERED = [(0.0, 0.0, 0.065), (0.245, 0.0, 0.04)]
FOUR = [(-0.3, 0.2, 0.05), (0.3, 0.2, 0.05), (0.2, 0.05, 0.05), (-0.2, 0.05, 0.05)]


def test_length_of_an_open_belt():
    """2 sqrt(L^2 - (R - r)^2) + pi (R + r) + 2 (R - r) asin((R - r) / L)."""
    big, small, apart = 0.065, 0.04, 0.245
    less = big - small
    length = 2 * np.sqrt(apart**2 - less**2) + np.pi * (big + small) + 2 * less * np.arcsin(less / apart)
    assert Outline.of(Hull.from_wheels(TAPERED)).ends[-1] == pytest.approx(length, rel=1e-12)


@pytest.mark.parametrize("hull", [TWO, TAPERED, FOUR])
def test_the_belt_is_closed_and_touches_its_hull(hull):
    outline = Outline.of(Hull.from_wheels(hull))
    length = outline.ends[-1]
    s = np.linspace(0, length, 4001)
    place, heading = outline.place(s)
    np.testing.assert_allclose(place[0], place[-1], atol=1e-12)
    step = np.diff(place, axis=0)
    np.testing.assert_allclose(np.hypot(*step.T), length / 4000, rtol=1e-4)
    middle = (s[:-1] + s[1:]) / 2
    turn = np.arctan2(step[:, 1], step[:, 0]) - outline.place(middle)[1]
    np.testing.assert_allclose(np.sin(turn), 0, atol=2e-3)
    x, z, radius = np.array(hull).T
    depth = (np.hypot(place[:, :1] - x, place[:, 1:] - z) - radius).min(axis=1)
    assert depth.min() > -1e-9  # nowhere inside a wheel
    assert np.ptp(np.unwrap(heading)) == pytest.approx(2 * np.pi, abs=1e-9)


def test_shoes_move_with_the_belt_and_wheels_roll():
    look = TrackLook(np.array(TWO), 0.2, 0.08)
    way = 0.01
    still, moved = look.pieces(0.0), look.pieces(way)
    np.testing.assert_array_equal(still.kind, moved.kind)
    shift = moved.position - still.position
    shoes = (still.kind == BOX) & (np.abs(shift).sum(axis=1) > 0)
    below = shoes & (still.position[:, 2] < 0.01) & (np.abs(still.position[:, 0]) < 0.15)
    np.testing.assert_allclose(shift[below], [[-way, 0, 0]] * below.sum(), atol=1e-12)
    assert below.sum() > 5
    above = shoes & (still.position[:, 2] > 0.15) & (np.abs(still.position[:, 0]) < 0.15)
    np.testing.assert_allclose(shift[above], [[way, 0, 0]] * above.sum(), atol=1e-12)
    bolts = (still.kind == CYLINDER) & (moved.angle != still.angle)
    # a belt drives the drawn wheel, which is thinner than the hull's by the belt
    drawn = still.size[still.kind == CYLINDER, 0].max()
    assert np.abs(moved.angle - still.angle)[bolts].min() == pytest.approx(way / drawn, rel=1e-9)
    first = np.flatnonzero(bolts)[0]
    assert shift[first, 0] > 0  # the first bolt is on top, and goes forwards


def test_pieces_take_many_ways_at_once():
    look = TrackLook(np.array(TAPERED), 0.0, 0.05)
    ways = np.array([0.0, 0.1, 0.7])
    many = look.pieces(ways)
    assert many.position.shape[0] == 3
    for k, way in enumerate(ways):
        one = look.pieces(way)
        np.testing.assert_array_equal(many.position[k], one.position)
        np.testing.assert_array_equal(many.angle[k], one.angle)
        np.testing.assert_array_equal(many.rotation[k], one.rotation)
