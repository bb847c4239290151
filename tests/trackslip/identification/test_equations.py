from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from drives import NOISE, drive_log, model

from trackslip.identification.drive_equations import solve, used_up
from trackslip.identification.drive_model import EXTRAS
from trackslip.identification.drive_residuals import Nodes, Noise, cost, residuals, weights
from trackslip.identification.drives import PreparedDrive, drive_of
from trackslip.identification.intervals import innovation_scores

LAWS = {"icr_radius": [0.045, 0.0066], "turn_loss": [0.045, 0.0066, 0.3], "icr_sides": [0.04, 0.05, 0.01, -0.01]}
NONE = np.zeros(0, int)
PLACED = [0.1, 0.05, 0.2, 0.03, 0.07]  # sensor_x, sensor_y, drift, clock_offset, sensor_yaw


def random_drive(seed=0, count=60):
    """Random poses, and sprocket speeds in intervals of their own."""
    rng = np.random.default_rng(seed)
    edges = np.arange(0, count / 10 + 2, 0.02)
    omega = 2 + np.cumsum(rng.normal(size=(len(edges) - 1, 2)) * 0.1, axis=0)
    time = 1 + np.arange(count) * 0.1
    pose = np.cumsum(rng.normal(size=(count, 3)) * 0.05, axis=0)
    return PreparedDrive(f"random {seed}", edges, omega, time, pose, np.arange(count), 0.1)


@pytest.mark.parametrize("lag", [0.0, 0.08])
@pytest.mark.parametrize("name", LAWS)
def test_derivatives_by_the_parameters_are_differences(name, lag):
    drive, driven = random_drive(), model(name)
    nodes, values = Nodes.of([drive]), np.array([*LAWS[name], *PLACED, lag])
    every = np.arange(len(values))
    found = residuals(driven, nodes, drive.pose, values, every)
    for k, parameter in enumerate(driven.names):
        ahead, behind = (values + h * (np.arange(len(values)) == k) for h in (1e-5, -1e-5))
        if parameter == "lag":
            behind = values  # 0 is its limit, and its derivative is such a difference itself
        there, back = (residuals(driven, nodes, drive.pose, at, NONE).step for at in (ahead, behind))
        expected = (there - back) / (ahead[k] - behind[k])
        within = (2e-2 if parameter == "lag" else 1e-6) * max(np.abs(expected).max(), 1e-3)
        np.testing.assert_allclose(found.by_values[..., k], expected, atol=within, err_msg=parameter)


def test_derivatives_by_the_states_are_differences():
    drive, driven = random_drive(), model()
    nodes, values = Nodes.of([drive]), np.array([*LAWS["icr_radius"], *PLACED, 0.0])
    found = residuals(driven, nodes, drive.pose, values, NONE)
    for j in range(3):
        ahead, behind = drive.pose.copy(), drive.pose.copy()
        ahead[10, j] += 1e-6
        behind[10, j] -= 1e-6
        steps = [residuals(driven, nodes, states, values, NONE).step for states in (ahead, behind)]
        slope = (steps[0] - steps[1]) / 2e-6
        np.testing.assert_allclose(slope[10], found.by_first[10, :, j], atol=1e-8)
        np.testing.assert_allclose(slope[9], found.by_second[9, :, j], atol=1e-8)
        assert not np.delete(slope, [9, 10], axis=0).any()


def test_residuals_vanish_at_the_truth():
    """A robot that moves by its law, seen by a sensor elsewhere with a clock of its own."""
    drive, driven = random_drive(), model()
    values = np.array([*LAWS["icr_radius"], *PLACED, 0.0])
    states = driven.sensor_path(values, drive)
    yaw = values[driven.index("sensor_yaw")]
    seen = replace(drive, pose=states + np.array([0, 0, yaw]))
    found = residuals(driven, Nodes.of([seen]), states, values, NONE)
    np.testing.assert_allclose(found.pose, 0, atol=1e-12)
    np.testing.assert_allclose(found.step, 0, atol=1e-12)


def problem(free=None, white=False):
    """Two drives with gaps, missing headings and a broken link, and everything that `solve` needs."""
    rng = np.random.default_rng(3)
    first, second = random_drive(1, 15), random_drive(2, 10)
    first.pose[5:8] = np.nan
    second.pose[:, 2] = np.nan
    if white:
        second = replace(second, whitening=np.tril(0.3 * rng.normal(size=(10, 3, 3))) + np.eye(3))
        second.whitening[:, :2, 2] = 0.0
    nodes = Nodes.of([first, second])
    nodes.link[9] = 0.0
    driven = model()
    values = np.array([*LAWS["icr_radius"], *PLACED, 0.0])
    states = np.nan_to_num(nodes.pose) + 0.01 * rng.normal(size=nodes.pose.shape)
    free = np.arange(len(values) - 1) if free is None else np.array(free, int)
    return driven, nodes, states, values, Noise(NOISE + np.array([0, 0, 0, 0, 0, 0.3, 0.3])), free


def dense(driven, nodes, states, values, noise, free):
    """Weighted residuals (m,), their Jacobian (m, 3 K + f), by differences of the residuals themselves.

    The weights vary little with the clock.
    """
    count = states.size
    poses, steps = weights(residuals(driven, nodes, states, values, NONE), nodes, noise)

    def stacked(at):
        moved = values.copy()
        moved[free] = at[count:]
        found = residuals(driven, nodes, at[:count].reshape(-1, 3), moved, NONE)
        prior = (moved - values)[free] / driven.prior[free]
        return np.concatenate([(np.sqrt(poses) * found.pose).ravel(), (np.sqrt(steps) * found.step).ravel(), prior])

    at = np.concatenate([states.ravel(), values[free]])
    unit = 1e-6 * np.eye(len(at))
    return stacked(at), np.stack([(stacked(at + h) - stacked(at - h)) / 2e-6 for h in unit], axis=-1)


@pytest.mark.parametrize("white", [False, True])
@pytest.mark.parametrize("free", [None, [0, 1], []])
def test_the_banded_solution_is_the_dense_one(free, white):
    case = driven, nodes, states, values, noise, free = problem(free, white)
    residual, jacobian = dense(*case)
    hessian = jacobian.T @ jacobian
    count = states.size
    hessian[np.arange(count), np.arange(count)] += 1e-3  # what ties nodes that nothing else ties
    step = -np.linalg.solve(hessian, jacobian.T @ residual)
    found = residuals(driven, nodes, states, values, free)
    yaw = driven.index("sensor_yaw")
    solved = solve(found, nodes, noise, yaw, driven.prior, np.zeros(len(values)))
    within = 1e-5 * np.abs(step).max()
    np.testing.assert_allclose(solved.states.ravel(), step[:count], atol=within)
    np.testing.assert_allclose(solved.values, step[count:], atol=within)
    schur = hessian[count:, count:] - hessian[count:, :count] @ np.linalg.solve(
        hessian[:count, :count], hessian[:count, count:]
    )
    np.testing.assert_allclose(solved.information, schur, rtol=1e-4, atol=1e-4 * np.abs(schur).max(initial=0))
    assert cost(found, nodes, noise) == pytest.approx(residual @ residual, rel=1e-12)


@pytest.mark.parametrize("white", [False, True])
@pytest.mark.parametrize("free", [None, [0, 1], []])
def test_every_kind_of_residual_is_used_up_by_its_share_of_the_hessian(free, white):
    """The trace of the inverse Hessian times the part of it that each variance scales."""
    case = driven, nodes, states, values, noise, free = problem(free, white)
    _, jacobian = dense(*case)
    inverse = np.linalg.inv(jacobian.T @ jacobian + 1e-3 * np.diag(np.arange(jacobian.shape[1]) < states.size))
    by_row = np.einsum("ri,ij,rj->r", jacobian, inverse, jacobian)
    poses, steps = by_row[: states.size].reshape(-1, 3), by_row[states.size : len(by_row) - len(free)].reshape(-1, 3)
    tied = 1e-3 * np.diag(inverse)[: states.size].sum() + by_row[len(by_row) - len(free) :].sum()  # and by priors
    found = residuals(driven, nodes, states, values, free)
    at_rest, added = noise.of_poses(found.rate)
    parts = [
        [(share[:, 0] * poses[:, :2].sum(axis=1)).sum(), (share[:, 1] * poses[:, 2]).sum()]
        for share in (at_rest / (at_rest + added), added / (at_rest + added))
    ]
    assert min(parts[1]) > 0.5
    expected = [*parts[0], *steps.sum(axis=0), *parts[1]]
    yaw = driven.index("sensor_yaw")
    solution = solve(found, nodes, noise, yaw, driven.prior, np.zeros(len(values)))
    used = used_up(found, nodes, noise, solution, yaw)
    np.testing.assert_allclose(used[1:], expected[1:], rtol=2e-3, atol=2e-3)  # differences of the weights by 1e-3
    assert used[0] == pytest.approx(expected[0] + tied, abs=0.01)


@pytest.mark.parametrize("limit", [0.2, 0.9])
def test_a_step_within_limits_is_the_least_one_there(limit):
    """At the limits the cost falls beyond them, within it has no slope: Karush, Kuhn and Tucker's conditions."""
    driven, nodes, states, values, noise, free = problem()
    found = residuals(driven, nodes, states, values, free)
    solution = solve(found, nodes, noise, driven.index("sensor_yaw"), driven.prior, np.zeros(len(values)))
    room = np.where(np.arange(len(free)) % 2, np.inf, limit * np.abs(solution.values))
    states, step = solution.limited(-room, room)
    slope = solution.information @ step + solution.right
    at = np.abs(step) >= room
    assert at.any()
    assert (np.abs(step) <= room * (1 + 1e-12)).all()
    np.testing.assert_allclose(slope[~at], 0, atol=1e-6 * np.abs(solution.right).max())
    reached = solution.reduced[..., -1] + solution.reduced[..., :-1] @ step
    lower = sum(np.diag(band[: len(band) - k], -k) for k, band in enumerate(solution.factor))
    np.testing.assert_allclose(lower.T @ states.ravel(), -reached.ravel(), atol=1e-8 * np.abs(reached).max())


def test_a_lag_and_the_clock_move_along_the_delay_that_they_share():
    driven = model()
    lag, clock = driven.index("lag"), driven.index("clock_offset")
    values = np.zeros(8)
    values[[lag, clock]] = 0.03, 0.01
    free = np.array([clock, lag])
    for by in (np.array([1e-6, 2e-6]), np.array([-1e-6, 1e-6])):  # as it is, to first order
        np.testing.assert_allclose(driven.moved(values, free, by)[free] - values[free], by, atol=1e-9)
    far = driven.moved(values, free, np.array([0.0, 0.05]))
    assert far[lag] ** 2 - values[lag] ** 2 == pytest.approx(2 * values[lag] * 0.05)
    assert far[clock] - far[lag] == pytest.approx(0.01 - 0.03 - 0.05)
    least, _ = driven.room(values, free)
    assert 0 < driven.moved(values, free, least)[lag] <= 1.001e-3
    np.testing.assert_array_equal(driven.moved(values, free[1:], np.array([0.05]))[free], [0.01, 0.08])


def test_a_pull_towards_the_prior_is_its_gradient():
    driven, nodes, states, values, noise, free = problem()
    found = residuals(driven, nodes, states, values, free)
    yaw = driven.index("sensor_yaw")
    pull = np.zeros(len(values))
    free_of_it = solve(found, nodes, noise, yaw, driven.prior, pull)
    pull[2] = 0.3
    pulled = solve(found, nodes, noise, yaw, driven.prior, pull)
    change = free_of_it.information @ (pulled.values - free_of_it.values)
    expected = np.zeros(len(free))
    expected[2] = -0.3 / EXTRAS["sensor_x"].prior ** 2
    np.testing.assert_allclose(change, expected, atol=1e-6)


def test_innovation_scores_are_gradients_with_the_trajectory_up_to_there_eliminated():
    case = driven, nodes, states, values, noise, free = problem()
    found = residuals(driven, nodes, states, values, free)
    solution = solve(found, nodes, noise, driven.index("sensor_yaw"), driven.prior, np.zeros(len(values)))
    fitted = SimpleNamespace(residuals=found, solution=solution, nodes=nodes, noise=noise, free=free)
    cuts = np.array([3, 6, 9, 12, 14, 20, 24])
    scores = innovation_scores(fitted, cuts)
    residual, jacobian = dense(*case)
    count, nodes_count = states.size, len(states)
    np.testing.assert_allclose(scores[-1], -solution.information @ solution.values, atol=1e-6 * np.abs(scores).max())
    for cut, score in zip(cuts, scores, strict=True):
        poses = np.repeat(np.arange(nodes_count) <= cut, 3)
        steps = np.repeat(np.arange(1, nodes_count) <= cut, 3)
        rows = np.flatnonzero(np.concatenate([poses, steps]))
        states_up_to = slice(0, 3 * (cut + 1))
        a, b, r = jacobian[rows, states_up_to], jacobian[rows, count:], residual[rows]
        hessian = a.T @ a + 1e-3 * np.eye(a.shape[1])
        expected = b.T @ r - b.T @ a @ np.linalg.solve(hessian, a.T @ r)
        np.testing.assert_allclose(score, expected, atol=2e-5 * np.abs(scores).max(axis=0).max())


def test_links_end_between_drives():
    drives = [drive_of(drive_log(seed, 5.0)) for seed in range(3)]
    nodes = Nodes.of(drives)
    assert nodes.first.tolist() == np.cumsum([0, *(len(drive.time) for drive in drives)]).tolist()
    np.testing.assert_array_equal(np.flatnonzero(nodes.link == 0), nodes.first[1:-1] - 1)
    found = residuals(model(), nodes, np.nan_to_num(nodes.pose), np.zeros(8), NONE)
    assert np.isfinite(found.step).all()
