import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tracked import add_robot, built, plane

from sim.tracks import DrawnTracks
from sim.tracks.hull import Hull

NOSE = [(-0.3, 0.08, 0.08), (0.2, 0.08, 0.08), (0.36, 0.2, 0.06)]


@given(
    st.integers(0, 6),
    st.booleans(),
    st.lists(st.tuples(st.floats(0.05, 1.0), st.floats(0.02, 0.05)), min_size=3, max_size=7),
)
def test_runs_are_tangents_for_any_first_wheel_and_sense(first, backwards, spokes):
    angles = -np.linspace(0, 2 * np.pi, len(spokes), endpoint=False)
    ring = [
        (np.cos(a) * 1.5, np.sin(a) * 1.5, radius)
        for a, (_, radius) in zip(angles, spokes, strict=True)
    ]
    chain = ring[first % len(ring) :] + ring[: first % len(ring)]
    hull = Hull.from_wheels(chain[::-1] if backwards else chain)
    assert len(hull.wheels) == len(ring)
    for run in hull.runs:  # every wheel lies inside, and two of them touch
        reach = hull.wheels[:, :2] @ run.outwards + hull.wheels[:, 2] - run.start @ run.outwards
        assert reach.max() < 1e-12
        assert (np.abs(reach) < 1e-12).sum() == 2


@given(st.permutations(range(8)))
def test_the_belt_runs_around_the_convex_hull_of_its_wheels(order):
    """As a Bunker's are: idlers above, a road wheel that hangs a little above its neighbours, and
    one inside.
    """
    outside = [(0.44, -0.13, 0.06), (0.29, -0.28, 0.05), (-0.23, -0.28, 0.05), (-0.39, -0.19, 0.08)]
    road, above = (
        [(0.04, -0.277, 0.05), (0.0, -0.2, 0.04)],
        [(-0.29, -0.087, 0.042), (0.3, -0.087, 0.042)],
    )
    wheels = [*outside, *road, *above]
    hull = Hull.from_wheels([wheels[k] for k in order])
    assert sorted(map(tuple, hull.wheels)) == sorted([*outside, *above])
    for run in hull.runs:
        x, z, radius = np.array(wheels).T
        reach = run.outwards @ [x, z] + radius - run.start @ run.outwards
        assert reach.max() < 1e-12


def test_the_length_of_the_belt_is_that_of_the_convex_hull():
    hull = Hull.from_wheels(NOSE)
    turns = np.linspace(0, 2 * np.pi, 20_001)
    reach = np.max(
        hull.wheels[:, :1] * np.cos(turns)
        + hull.wheels[:, 1:2] * np.sin(turns)
        + hull.wheels[:, 2:],
        axis=0,
    )
    perimeter = np.trapezoid(reach, turns)  # Cauchy's formula
    assert hull.ends[-1] == pytest.approx(perimeter, rel=1e-6)


def test_belts_move_as_far_as_they_run_and_with_their_body():
    spec = plane()
    add_robot(spec)
    model, data, belts = built(spec)
    scene, drawn = mujoco.MjvScene(model, 1000), DrawnTracks(belts)

    def places():
        mujoco.mj_forward(model, data)
        scene.ngeom = 0
        drawn.draw(scene, data)
        return np.array([scene.geoms[k].pos for k in range(scene.ngeom)])

    first = places()
    np.testing.assert_allclose(np.abs(first[:, 1]), 0.2, atol=1e-6)
    belts.set([0.1, 0.0])
    data.time = 0.1
    later, left = places(), first[:, 1] > 0
    np.testing.assert_array_equal(later[~left], first[~left])
    # shoes on the ground go backwards
    lower = left & (first[:, 2] < 0.01) & (np.abs(first[:, 0]) < 0.2)
    np.testing.assert_allclose(
        later[lower] - first[lower], [[-0.01, 0, 0]] * lower.sum(), atol=1e-6
    )
    assert lower.sum() > 5
    data.time = 0.0
    np.testing.assert_array_equal(places(), first)
    half = np.pi / 4
    data.qpos[:7] = 1.0, 2.0, 0.5, np.cos(half), 0, 0, np.sin(half)  # a quarter turn to the left
    turned = first @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + [1.0, 2.0, 0.5]
    np.testing.assert_allclose(places(), turned, atol=1e-6)
