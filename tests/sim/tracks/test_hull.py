import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tracked import add_robot, built, plane

from sim.tracks import DrawnTracks
from sim.tracks.drawing import BOX, TrackLook
from sim.tracks.hull import Hull

NOSE = [(-0.3, 0.08, 0.08), (0.2, 0.08, 0.08), (0.36, 0.2, 0.06)]


def beyond(run, wheels):
    """Distances (W,) that wheels (W, 3) reach beyond a run's line."""
    return wheels[:, :2] @ run.outwards + wheels[:, 2] - run.start @ run.outwards


@given(
    st.integers(0, 6),
    st.booleans(),
    st.lists(st.tuples(st.floats(0.05, 1.0), st.floats(0.02, 0.05)), min_size=3, max_size=7),
)
def test_runs_are_tangents_for_any_first_wheel_and_sense(first, backwards, spokes):
    angles = -np.linspace(0, 2 * np.pi, len(spokes), endpoint=False)
    ring = []
    for angle, (_, radius) in zip(angles, spokes, strict=True):
        ring.append((np.cos(angle) * 1.5, np.sin(angle) * 1.5, radius))
    begin = first % len(ring)
    chain = ring[begin:] + ring[:begin]
    if backwards:
        chain = chain[::-1]
    hull = Hull.from_wheels(chain)
    assert len(hull.wheels) == len(ring)
    for run in hull.runs:  # every wheel lies inside, and two of them touch
        reach = beyond(run, hull.wheels)
        assert reach.max() < 1e-12
        assert (np.abs(reach) < 1e-12).sum() == 2


@given(st.permutations(range(8)))
def test_the_belt_runs_around_the_convex_hull_of_its_wheels(order):
    """As a Bunker's are: idlers above, a road wheel that hangs a little above its neighbours, and
    one inside.
    """
    outside = [(0.44, -0.13, 0.06), (0.29, -0.28, 0.05), (-0.23, -0.28, 0.05), (-0.39, -0.19, 0.08)]
    road = [(0.04, -0.277, 0.05), (0.0, -0.2, 0.04)]
    above = [(-0.29, -0.087, 0.042), (0.3, -0.087, 0.042)]
    wheels = [*outside, *road, *above]
    hull = Hull.from_wheels([wheels[k] for k in order])
    assert sorted(map(tuple, hull.wheels)) == sorted([*outside, *above])
    for run in hull.runs:
        assert beyond(run, np.array(wheels)).max() < 1e-12


def test_the_length_of_the_belt_is_that_of_the_convex_hull():
    hull = Hull.from_wheels(NOSE)
    """Cauchy's formula: the integral of the reach over all directions."""
    x, z, radius = hull.wheels.T[:, :, None]
    turns = np.linspace(0, 2 * np.pi, 20_001)
    reach = x * np.cos(turns) + z * np.sin(turns) + radius
    perimeter = np.trapezoid(reach.max(axis=0), turns)
    assert hull.ends[-1] == pytest.approx(perimeter, rel=1e-6)


def test_the_belt_is_closed_and_runs_in_its_direction():
    """Its direction is the derivative of its place, also where the last arc meets the first run."""
    hull = Hull.from_wheels(NOSE)
    length = hull.ends[-1]
    distance = np.linspace(-length, 2 * length, 3001)
    _, heading = hull.place(distance)
    h = 1e-6
    ahead, _ = hull.place(distance + h)
    behind, _ = hull.place(distance - h)
    direction = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    np.testing.assert_allclose((ahead - behind) / (2 * h), direction, atol=1e-4)
    start, _ = hull.place(np.array(0.0))
    end, _ = hull.place(np.array(-1e-20))  # rounds to the whole length
    np.testing.assert_allclose(end, start, atol=1e-12)


def test_shoes_cover_the_belt_without_gaps():
    """The middle of the shoes lies by half of their thickness inside the hull, whose length is
    shorter there by 2 pi times as much (J. Steiner).
    """
    hull = Hull.from_wheels(NOSE)
    pieces = TrackLook(hull.wheels, 0.0, 0.08).pieces(0.0)
    length, _, thickness = 2 * pieces.size[pieces.kind == BOX].T
    expected = hull.ends[-1] - 2 * np.pi * thickness[0] / 2
    assert length.sum() == pytest.approx(expected)


def test_belts_move_as_far_as_they_run_and_with_their_body():
    spec = plane()
    add_robot(spec)
    model, data, belts = built(spec)
    scene = mujoco.MjvScene(model, 1000)
    drawn = DrawnTracks(belts)

    def places():
        mujoco.mj_forward(model, data)
        scene.ngeom = 0
        drawn.draw(scene, data)
        return np.array([scene.geoms[k].pos for k in range(scene.ngeom)])

    first = places()
    np.testing.assert_allclose(np.abs(first[:, 1]), 0.2, atol=1e-6)
    belts.set([0.1, 0.0])
    data.time = 0.1
    later = places()
    left = first[:, 1] > 0
    np.testing.assert_array_equal(later[~left], first[~left])
    # shoes on the ground go backwards
    on_ground = (first[:, 2] < 0.01) & (np.abs(first[:, 0]) < 0.2)
    lower = left & on_ground
    moved = later[lower] - first[lower]
    np.testing.assert_allclose(moved, [[-0.01, 0, 0]] * lower.sum(), atol=1e-6)
    assert lower.sum() > 5
    data.time = 0.0
    np.testing.assert_array_equal(places(), first)
    half = np.pi / 4
    data.qpos[:7] = 1.0, 2.0, 0.5, np.cos(half), 0, 0, np.sin(half)  # a quarter turn to the left
    x, y, z = first.T
    turned = np.column_stack([1.0 - y, 2.0 + x, 0.5 + z])
    np.testing.assert_allclose(places(), turned, atol=1e-6)
