"""The robot in a recording: its geometry, its pose, the forces on it, and its paths: driven, measured and desired."""

from collections.abc import Sequence

import mujoco
import numpy as np
import rerun as rr

from experiments.recording import robot_mesh
from experiments.recording.columns import at_height, mesh, rgb, send, send_poses
from experiments.recording.sensing import ESTIMATE_COLOUR
from experiments.recording.traces import Traces
from experiments.report.colours import GREEN
from trackslip.kinematics import Array

ROBOT = "robot"  # its entity, below that of the run
CAMERA = "camera"
_REFERENCE_COLOUR = "#b8b8b8"
_ABOVE = 0.004  # height of lines above the ground, and above each other [m]
_PHASES = 8  # places of a shoe between two neighbours, so that rows repeat and compress well
_MARKED = 11  # one shoe in so many is painted, which shows the belt moving
_NEWTON = 0.004  # length of a force arrow [m/N]
_SHEARED = ((40, 60, 140), (60, 170, 130), (250, 230, 60))  # colours of ground, from firm to farthest given way
_STRONGEST = 0.98  # quantile of the shear with the last of these colours
_BESIDE = 0.06  # distance from a pad to its arrow, which the track would hide [m]


def send_robot(stream: rr.RecordingStream, entity: str, traces: Traces, model: mujoco.MjModel) -> None:
    """Send the robot's geometry and pose, with moving shoes."""
    robot = f"{entity}/{ROBOT}"
    send_poses(stream, robot, traces.time, traces.pose)
    stream.log(f"{robot}/body", mesh(robot_mesh.body(model, robot_mesh.CHASSIS, without=robot_mesh.BELTS)), static=True)
    speed = traces.log.omega * float(model.geom("left_sprocket").size[0])
    travel = np.cumsum(speed * np.diff(traces.time, prepend=0.0)[:, None], axis=0)
    for track, name in enumerate(robot_mesh.BELTS):
        band, belt = robot_mesh.belt(model, name)
        stream.log(f"{robot}/{name}", mesh(band), static=True)
        if belt is not None:
            _send_shoes(stream, f"{robot}/{name}", traces.time, travel[:, track], belt)


def _send_shoes(stream: rr.RecordingStream, entity: str, time: Array, travel: Array, belt: robot_mesh.Belt) -> None:
    """Send a belt's shoes after `travel` (T,) [m]: all of them within one pitch, painted ones all the way around."""
    step = np.rint(travel / belt.pitch * _PHASES) / _PHASES
    changed = np.flatnonzero(np.diff(step, prepend=np.nan) != 0)
    painted = np.arange(0, len(belt.place), _MARKED)
    for name, rows, run, which, size, colour in (
        ("shoes", changed, (step % 1)[changed] * belt.pitch, slice(None), 1.0, (38, 38, 42, 255)),
        ("painted_shoes", slice(None), travel, painted, 1.15, (230, 159, 0, 255)),
    ):
        where, turn = (part[:, which] for part in belt.shoes(run))
        shoe = robot_mesh.Triangles(size * belt.shoe, np.tile(np.array(colour, np.uint8), (len(belt.shoe), 1)))
        stream.log(f"{entity}/{name}", mesh(shoe), static=True)
        poses = rr.InstancePoses3D.columns(translations=where.reshape(-1, 3), quaternions=turn.reshape(-1, 4))
        send(stream, f"{entity}/{name}", time[rows], poses.partition(np.full(len(where), where.shape[1])))


def send_camera(stream: rr.RecordingStream, runs: Sequence[Traces]) -> None:
    """Send the position of a camera that follows the middle of the robots without turning."""
    time = max((traces.time for traces in runs), key=lambda time: float(time[-1]))
    places = [[np.interp(time, traces.time, column) for column in traces.pose.T] for traces in runs]
    middle = np.mean(places, axis=0).T
    send(stream, CAMERA, time, rr.Transform3D.columns(translation=at_height(middle)))


def send_simple_robot(
    stream: rr.RecordingStream, entity: str, traces: Traces, model: mujoco.MjModel, colour: str
) -> None:
    """Send the robot painted in one colour, with tracks at rest."""
    robot = f"{entity}/{ROBOT}"
    send_poses(stream, robot, traces.time, traces.pose)
    body = robot_mesh.body(model, robot_mesh.CHASSIS, without=("left_wheels", "right_wheels"))
    rubber = body.colours[:, :3].max(axis=1, keepdims=True) < 40
    painted = np.where(rubber, body.colours, np.array([*rgb(colour), 255], np.uint8))
    stream.log(f"{robot}/body", mesh(robot_mesh.Triangles(body.vertices, painted)), static=True)


def send_contacts(stream: rr.RecordingStream, entity: str, traces: Traces, model: mujoco.MjModel) -> None:
    """Send the contact forces on the pads, if the log has them, as arrows beside the pads."""
    force = None if traces.log.truth is None else traces.log.truth.contact
    pads = None if force is None else _beside_pads(model, force.shape[1])
    if force is None or pads is None:
        return
    arrows = f"{entity}/{ROBOT}/contact_forces"
    stream.log(arrows, rr.Arrows3D.from_fields(origins=pads, colors=[rgb(GREEN)], radii=[0.004]), static=True)
    vectors = rr.Arrows3D.columns(vectors=(_NEWTON * force).reshape(-1, 3))
    send(stream, arrows, traces.time, vectors.partition(np.full(len(force), len(pads))))


def send_shear(stream: rr.RecordingStream, entity: str, traces: Traces, model: mujoco.MjModel) -> None:
    """Send how far the ground has given way under each track, if the log has it, as a coloured line beside it."""
    shear = None if traces.log.truth is None else traces.log.truth.shear
    pads = None if shear is None else _beside_pads(model, shear.shape[1])
    if shear is None or pads is None or not len(shear):
        return
    lines = np.concatenate([np.stack([track[:-1], track[1:]], axis=1) for track in np.split(pads, 2)])
    middle = np.concatenate([(track[:, :-1] + track[:, 1:]) / 2 for track in np.split(shear, 2, axis=1)], axis=1)
    share = middle / max(float(np.quantile(shear, _STRONGEST)), 1e-9)
    colours = np.stack([np.interp(share, np.linspace(0, 1, 3), band) for band in np.transpose(_SHEARED)], axis=-1)
    strips = f"{entity}/{ROBOT}/shear"
    stream.log(strips, rr.LineStrips3D.from_fields(strips=list(lines), radii=[0.012]), static=True)
    columns = rr.LineStrips3D.columns(colors=np.rint(colours).astype(np.uint8).reshape(-1, 3))
    send(stream, strips, traces.time, columns.partition(np.full(len(shear), len(lines))))


def _beside_pads(model: mujoco.MjModel, count: int) -> Array | None:
    """Places (count, 3) beside the pads of a model, or beside their ends if there are twice as many [m]."""
    pads = [i for i in range(model.ngeom) if "_pad" in model.geom(i).name]
    places = model.geom_pos[pads]
    if count == 2 * len(pads):  # pads that touch the ground at one point each
        half = model.geom_size[pads, 1, None] * [1.0, 0.0, 0.0]
        ends = np.stack([places - half, places + half], axis=1).reshape(-1, 3)
        places = ends[np.lexsort([ends[:, 0], -ends[:, 1]])]
    return places + np.sign(places) * [0, _BESIDE, 0] if count == len(places) else None


def send_paths(stream: rr.RecordingStream, entity: str, traces: Traces, colour: str, estimate: bool) -> None:
    """Send the true path and the measured one."""
    known = traces.estimate[np.isfinite(traces.estimate).all(axis=1)]
    lines = [("true", traces.pose, colour, 0.008)] if traces.log.truth is not None else []
    if estimate or traces.log.truth is None:
        lines.append(("estimated", known, ESTIMATE_COLOUR if traces.log.truth is not None else colour, 0.004))
    for k, (name, pose, line_colour, radius) in enumerate(lines):
        if len(pose):
            strip = rr.LineStrips3D([at_height(pose, (k + 2) * _ABOVE)], colors=[rgb(line_colour)], radii=[radius])
            stream.log(f"{entity}/path/{name}", strip, static=True)


def send_reference(stream: rr.RecordingStream, entity: str, traces: Traces) -> None:
    """Send the reference of the run, and the place on it where the robot should be."""
    if traces.reference is None:
        return
    strip = rr.LineStrips3D([at_height(traces.reference, _ABOVE)], colors=[rgb(_REFERENCE_COLOUR)], radii=[0.016])
    stream.log(f"{entity}/path", strip, static=True)
    target = rr.Arrows3D(vectors=[[0.25, 0, 0]], origins=[[0, 0, 0.02]], colors=[(255, 255, 255)], radii=[0.012])
    stream.log(f"{entity}/target", target, static=True)
    send_poses(stream, f"{entity}/target", traces.time, traces.reference, _ABOVE)
