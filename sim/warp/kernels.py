# mypy: disable-error-code="untyped-decorator, no-untyped-def"
"""Kernels that carry the state of N worlds between double precision and MuJoCo Warp's single precision."""

import warp as wp

_POSE = wp.constant(7)  # numbers in the pose of a free joint: position, quaternion
_QPOS = wp.constant(1)  # where positions begin in a state, after the time


@wp.kernel(enable_backward=False)
def round_state(state: wp.array2d[wp.float64], rounded: wp.array2d[wp.float32]):
    """Round states (N, state)."""
    world, k = wp.tid()
    rounded[world, k] = wp.float32(state[world, k])


@wp.kernel(enable_backward=False)
def integrate_pose(
    step: wp.float64, qvel: wp.array2d[wp.float32], state: wp.array2d[wp.float64], qpos: wp.array2d[wp.float32]
):
    """Let a physics step of the robot's free joint pass; the engine does the same in single precision."""
    world = wp.tid()
    state[world, 0] = state[world, 0] + step
    for k in range(3):
        place = state[world, _QPOS + k] + step * wp.float64(qvel[world, k])
        state[world, _QPOS + k] = place
        qpos[world, k] = wp.float32(place)
    spin = wp.vec3d(wp.float64(qvel[world, 3]), wp.float64(qvel[world, 4]), wp.float64(qvel[world, 5]))  # in its frame
    first = _QPOS + 3
    rotation = wp.quatd(state[world, first + 1], state[world, first + 2], state[world, first + 3], state[world, first])
    rate = wp.length(spin)
    if rate > wp.float64(0.0):
        rotation = wp.normalize(rotation * wp.quat_from_axis_angle(spin / rate, rate * step))
    # Warp's quaternions end with the real part, MuJoCo's begin with it
    for k in range(4):
        state[world, first + k] = rotation[(k + 3) % 4]
        qpos[world, 3 + k] = wp.float32(rotation[(k + 3) % 4])


@wp.kernel(enable_backward=False)
def widen_state(rounded: wp.array2d[wp.float32], state: wp.array2d[wp.float64]):
    """Take states (N, state) over, but for the time and the robot's pose, which are known in double precision."""
    world, k = wp.tid()
    if k >= _QPOS + _POSE:
        state[world, k] = wp.float64(rounded[world, k])
