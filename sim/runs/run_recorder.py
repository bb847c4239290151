"""Recording of N runs row by row, and the RunLogs from their rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from sim.engine.simulations import States
from sim.fleet.fleet import Fleet
from sim.robot.parameters import TRACKS
from sim.robot.robot import CONTACT_WIDTH
from trackslip import se2
from trackslip.errors import RunFailedError as RunFailedError
from trackslip.errors import require
from trackslip.kinematics import Array
from trackslip.laws.base import SlipLaw
from trackslip.localization.pose_estimate import PoseEstimate
from trackslip.logs.runlog import RunLog, ScanLog, Truth
from trackslip.metrics import at_top_speed

FAILURE: Final = "failure"
"""Key in a log's metadata for the reason if the run ended early."""
SATURATION: Final = "saturation"
"""Key in a log's metadata for its `Saturation`, if a motor was at its limit."""
SINKING: Final = "sinking"
"""Key in a log's metadata for its `Sinking`, if the ground was soft soil."""
_STUCK: Final = 0.95  # slip beyond which a robot stands still while its tracks dig [-]
# pitch beyond which simulation and theory of rigid tracks were seen to differ [rad]
_STEEP: Final = float(np.radians(3.0))
LOST_AFTER: Final = 0.5
"""Time without a valid pose after which a robot is lost; scans that miss the plate now and then, or
show it edge-on, are no reason to stop [s].
"""
TOP_SPEED_SHARE: Final = "top_speed_share"
"""Key in the metadata of a closed-loop run for the share of the time with a set point at the top
speed, unless it is so small that the robot hardly misses it.
"""
# a controller that starts beside its path may be at the top speed for a moment [-]
_LEAST_TOP_SPEED_SHARE: Final = 0.01
# of motors; one in the middle runs at the mean of both sides
_SIDES: Final = ("left", "right", "middle")
_ICR: Final = ("offset", "radius_error")  # attributes of laws that record their ICRs
_UPRIGHT: Final = float(np.cos(0.5))  # cosine of the lean beyond which a robot has tipped over
_LEAST_SHARE: Final = 5e-4  # share of the time that a warning would round to 0.0 % [-]
_OF_SOIL: Final = ("sinkage", "resistance")  # fields of Truth that runs on firm ground lack
# data of a contact sensor
_LOAD: Final = 0
_FORCE: Final = slice(1, 3)
_POSITION: Final = slice(3, 5)
_RISING: Final = 6
_VELOCITY: Final = slice(7, 9)


@dataclass(frozen=True)
class Contacts:
    """Contact forces and sliding at K points on each of N robots, one physics step ago."""

    load: Array  # (N, K) normal force [N]
    force: Array  # (N, K, 2) tangential force on the robot, along and across the pad [N]
    # (N, K, 2) velocity of the points over the ground, along and across the pad [m/s]
    velocity: Array
    rising: Array  # (N, K) vertical speed, positive upwards [m/s]
    belt: Array  # (N, K) speed of the belt relative to the robot, along the pad [m/s]
    position: Array  # (N, K, 2) position in the robot's frame [m]


def read_contacts(fleet: Fleet) -> Contacts:
    """Read the contacts of a fleet, whose robot must have been loaded with contact sensors."""
    sensed = _of_points(fleet, fleet.batch.bind("sensordata"))
    pad_belts = fleet.belts / np.abs(fleet.robot.pad_sign)
    return Contacts(
        load=sensed[..., _LOAD].copy(),
        force=sensed[..., _FORCE].copy(),
        velocity=sensed[..., _VELOCITY].copy(),
        rising=sensed[..., _RISING].copy(),
        belt=np.repeat(pad_belts, fleet.robot.points_per_pad, axis=1),
        position=se2.from_world(fleet.pose()[:, None], sensed[..., _POSITION]),
    )


def pad_forces(fleet: Fleet) -> Array:
    """Mean forces (N, P, 3) of the ground on the pads over the last `advance`: forwards, to the
    left, up [N].

    The fleet's robot must have been loaded with contact sensors.
    """
    sensed = _of_points(fleet, fleet.sensed)
    points = fleet.robot.points_per_pad
    direction = np.repeat(np.sign(fleet.robot.pad_sign), points)  # pads may point backwards
    tangential = sensed[..., _FORCE] * direction[:, None]
    normal = sensed[..., _LOAD, None]
    of_points = np.concatenate([tangential, normal], axis=-1)
    return of_points.reshape(fleet.size, -1, points, 3).sum(axis=2)


def _of_points(fleet: Fleet, sensed: Array) -> Array:
    """Data of the contact sensors at each point (N, K, CONTACT_WIDTH), from the data of all sensors
    (N, S).
    """
    points = len(fleet.robot.pad_side) * fleet.robot.points_per_pad
    of_contacts = sensed[:, -points * CONTACT_WIDTH :]
    return of_contacts.reshape(fleet.size, points, CONTACT_WIDTH)


@dataclass(frozen=True)
class Description:
    """Name and metadata of a run."""

    run: str
    metadata: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Saturation:
    """The motor of a run that was at its limit for longer, and by how much it was too weak."""

    motor: str
    """Side of the motor: left, right or middle."""
    share: float
    """Share of the time at the limit [-]."""
    torque: float
    """Median torque at hand while the motor was too weak [N m]."""
    needed: float
    """Median torque that the set points took while the motor was too weak [N m]."""

    @classmethod
    def of(cls, saturated: Array, torque: Array, needed: Array) -> Saturation | None:
        """Find it from shares of the time, torques and needed torques (T, M) of M motors [N m];
        None if no motor was at its limit for a share that counts.

        The torques are medians, as the largest needed torque is a peak at the start that says
        nothing of the time at the limit: 0.35 N m for a robot that needs 0.22 N m up a slope.
        """
        share = saturated.mean(axis=0)
        side = int(share.argmax())
        if share[side] < _LEAST_SHARE:
            return None
        at_hand = np.abs(torque[:, side])
        wanted = np.abs(needed[:, side])
        is_limited = saturated[:, side] > 0
        # at the end of some rows the motor was strong enough again
        is_weak = is_limited & (wanted > at_hand)
        rows = is_weak if is_weak.any() else is_limited
        return cls(
            motor=_SIDES[side],
            share=float(share[side]),
            torque=float(np.median(at_hand[rows])),
            needed=float(np.median(wanted[rows])),
        )

    def __str__(self) -> str:
        """The warning on the motor."""
        return (
            f"the {self.motor} motor is at its limit for {self.share:.1%} of the time: "
            f"{self.torque:.3g} N m at hand, {self.needed:.3g} N m needed"
        )


@dataclass(frozen=True)
class Sinking:
    """How a robot sank into soft soil in a run."""

    sinkage: float
    """Median depth of its ruts [m]."""
    resistance: float
    """Median force of compaction on both tracks, against the motion [N]."""
    pitch: float
    """Largest angle between robot and ground, forwards or backwards [rad]."""
    slip: float
    """Smaller magnitude of the tracks' slips at the end [-]."""
    contact: str = TRACKS
    """What sank in: "tracks" or "wheels"."""

    @classmethod
    def of(
        cls, rut: Array, resistance: Array, slip: Array, pitch: Array, contact: str = TRACKS
    ) -> Sinking:
        """Find it from depths, forces and slips (T, 2) of both sides and pitches (T,)."""
        return cls(
            sinkage=float(np.median(rut.mean(axis=1))),
            resistance=float(np.median(np.abs(resistance.sum(axis=1)))),
            pitch=float(np.abs(pitch).max()),
            slip=float(np.abs(slip[-1]).min()),
            contact=contact,
        )

    @property
    def is_immobilised(self) -> bool:
        """Whether the robot stood still at the end while its tracks dug."""
        return self.slip > _STUCK

    @property
    def notes(self) -> list[str]:
        """What a reader of the run must know."""
        notes = []
        if self.is_immobilised:
            depth = 1e3 * self.sinkage
            digging = f"the {self.contact} dig at a slip of {self.slip:.2f}, {depth:.0f} mm deep"
            notes.append(f"immobilised: {digging}")
        if self.pitch > _STEEP and self.contact == TRACKS:
            angle = np.degrees(self.pitch)
            notes.append(
                f"the robot tilts by up to {angle:.1f}° in its ruts: beyond 3°, rigid tracks are a "
                "rough model"
            )
        return notes


class RunRecorder:
    """Recording of N runs, row by row.

    A row is complete once its command has been recorded; only complete rows are logged.
    """

    def __init__(
        self, fleet: Fleet, rows: int, period: float, descriptions: Sequence[Description] | None
    ) -> None:
        n = fleet.size
        if descriptions is None:
            geometry = vars(fleet.robot.geometry)
            descriptions = [Description(f"run {k}", {"geometry": geometry}) for k in range(n)]
        require(
            len(descriptions) == n,
            "descriptions",
            f"{len(descriptions)} descriptions",
            f"{n}, one per robot",
        )
        self.fleet = fleet
        self.period = period
        self._descriptions = descriptions
        self._angle = fleet.drive.encoder_angle()
        # whether its ground shears
        self._yields = [ground.largest_shear > 0 for ground in fleet.ground]
        self._loads = any(self._yields)
        self._in_detail = fleet.robot.contact_sensors
        self.complete = 0  # number of complete rows
        self.time = np.arange(rows) * period  # (T,) [s]
        self.omega = np.zeros((rows, n, 2))  # [rad/s]
        self.pose = np.zeros((rows, n, 3))  # [m, m, rad]
        self.load = np.zeros((rows, n, 2))
        """Tractions per load (T, N, 2) that the robots need, forwards and to the left [-]; 0 unless
        sensed.
        """
        self._command = np.zeros((rows, n, 2))
        self._twist_command = np.full((rows, n, 2), np.nan)
        self._icr = np.full((rows, n, 2), np.nan)
        self._covariance = np.zeros((rows, n, 3, 3))
        self._valid = np.zeros((rows, n), bool)
        self._truth: list[dict[str, Array]] = []  # per row, arrays (N, ...)

    def measure(self, k: int) -> None:
        """Record encoders and truth for row k; raises RunFailedError if a robot has tipped over."""
        fleet = self.fleet
        drive = fleet.drive
        self._require_upright(k)
        angle = drive.encoder_angle()
        self.omega[k] = (angle - self._angle) / self.period
        self._angle = angle
        if self._loads:
            self.load[k] = fleet.needed_traction()
        row = {
            "qpos": fleet.state.qpos,  # for twists and lean
            "qvel": fleet.state.qvel,
            "pose": fleet.pose(),
            "traction": fleet.mean_traction,
            "torque": drive.torque,
            "needed": drive.needed,
            "energy": drive.energy,
            "saturated_time": drive.saturated_time,
        }
        if fleet.ruts is not None:
            row["sinkage"] = fleet.ruts.deepest
            row["resistance"] = fleet.ruts.resistance
            row["slip"] = fleet.ruts.slip
        if self._in_detail:
            row["contact"] = pad_forces(fleet).astype(np.float32)
        if self._in_detail and fleet.shear is not None:
            size = np.linalg.norm(fleet.shear.displacement, axis=-1)
            row["shear"] = size.astype(np.float32)
        self._truth.append({name: values.copy() for name, values in row.items()})

    def _require_upright(self, k: int) -> None:
        upright = self.fleet.state.upright > _UPRIGHT
        if not upright.all():
            fallen = int(np.flatnonzero(~upright)[0])
            raise RunFailedError(
                f"run {self.name(fallen)!r}: the robot tips over after {self.time[k]:g} s"
            )

    def sense_loads(self) -> None:
        """Record the loads of all robots from the next row on."""
        self._loads = True

    def command(self, k: int, omega: Array) -> None:
        """Record the set points (N, 2) given in row k [rad/s], which completes the row."""
        self._command[k] = omega
        self.complete = k + 1

    def estimate(self, rows: int | slice, estimate: PoseEstimate) -> None:
        """Record poses estimated for a row (N,) or for T rows (T, N)."""
        self.pose[rows] = estimate.pose
        self._covariance[rows] = estimate.covariance
        self._valid[rows] = estimate.valid

    def name(self, robot: int) -> str:
        """Name of the run of a robot, given by its index."""
        return self._descriptions[robot].run

    def estimated(self, k: int, robots: Sequence[int]) -> PoseEstimate:
        """Estimated poses (R,) of the robots with these indices in row k."""
        return PoseEstimate(
            self.pose[k, robots], self._covariance[k, robots], self._valid[k, robots]
        )

    def is_lost(self, k: int, robots: Sequence[int]) -> np.ndarray:
        """Mask (R,) of the robots without a valid pose during the last LOST_AFTER before row k.

        Start poses count as valid.
        """
        rows = max(round(LOST_AFTER / self.period), 1)
        if k < rows:
            return np.zeros(len(robots), bool)
        recent = self._valid[k + 1 - rows : k + 1, robots]
        return np.asarray(~recent.any(axis=0))

    def require_twists(self, k: int, robots: Sequence[int], twist: Array) -> None:
        """Raise RunFailedError unless a controller requests finite twists (R, 2) in row k."""
        expected = (len(robots), 2)
        if twist.shape != expected:
            what = f"twists have the shape {twist.shape}: must be {expected}, one per pose"
            raise RunFailedError(f"run {self.name(robots[0])!r}: its controller's {what}")
        is_finite = np.isfinite(twist)
        if np.count_nonzero(is_finite) < twist.size:
            i = int(np.flatnonzero(~is_finite.all(axis=1))[0])
            returned = tuple(twist[i].tolist())
            what = f"returns the twist {returned} at {self.time[k]:g} s: must be finite"
            raise RunFailedError(f"run {self.name(robots[i])!r}: its controller {what}")

    def wanted(self, k: int, robots: Sequence[int], twist: Array) -> None:
        """Record the twists (R, 2) to drive from row k on."""
        self._twist_command[k, robots] = twist

    def compensated(self, k: int, robots: Sequence[int], law: SlipLaw) -> None:
        """Record the law that converts the twists of R robots into sprocket speeds in row k."""
        if law.records_icr:
            for column, name in enumerate(_ICR):
                self._icr[k, robots, column] = getattr(law, name)

    def logs(
        self, scans: Sequence[ScanLog | None] | None = None, failure: str | None = None
    ) -> list[RunLog]:
        """One log per run, with its complete rows and `scans`; no logs if there are fewer than two
        rows.

        `failure` is the reason if the runs ended early.
        """
        if self.complete < 2:
            return []
        rows = self._truth[: self.complete]
        truth = {name: np.stack([row[name] for row in rows]) for name in rows[0]}  # (T, N, ...)
        needed = truth.pop("needed")
        states = States(truth.pop("qpos"), truth.pop("qvel"))
        truth["twist"] = states.twist
        truth["lean"] = states.lean(self.fleet.robot.lrf_height)
        truth["power"] = self._rates(truth.pop("energy"))
        truth["saturated"] = self._rates(truth.pop("saturated_time"))

        ruts = self.fleet.ruts
        slip = truth.pop("slip", None)
        logs = []
        for i in range(self.fleet.size):
            own = {name: values[:, i] for name, values in truth.items()}
            sinking = None
            if ruts is not None and slip is not None and ruts.is_soft[i]:
                pitch = states.pitch[:, i]
                soil = own["sinkage"], own["resistance"], slip[:, i], pitch
                sinking = Sinking.of(*soil, self.fleet.robot.parameters.contact)
            else:
                for name in _OF_SOIL:
                    own.pop(name, None)
            saturation = Saturation.of(own["saturated"], own["torque"], needed[:, i])
            own_scans = scans[i] if scans else None
            logs.append(self._log(i, Truth(**own), own_scans, saturation, sinking, failure))
        return logs

    def _rates(self, total: Array) -> Array:
        """Mean rates (T, N, 2) since the previous row, 0 in the first, of what adds up to `total`
        (T, N, 2).
        """
        return np.diff(total, axis=0, prepend=total[:1]) / self.period

    def _log(
        self,
        i: int,
        truth: Truth,
        scans: ScanLog | None,
        saturation: Saturation | None,
        sinking: Sinking | None,
        failure: str | None,
    ) -> RunLog:
        rows = slice(self.complete)
        description = self._descriptions[i]
        metadata = dict(description.metadata)
        if saturation is not None:
            metadata[SATURATION] = vars(saturation)
        if sinking is not None:
            metadata[SINKING] = vars(sinking)
        is_closed = not np.isnan(self._twist_command[rows, i]).any()
        is_at_top = at_top_speed(self._command[rows, i], self.fleet.drive.limit)
        if is_closed and is_at_top.mean() >= _LEAST_TOP_SPEED_SHARE:
            metadata[TOP_SPEED_SHARE] = float(is_at_top.mean())
        if failure is not None:
            metadata[FAILURE] = failure
        return RunLog(
            run=description.run,
            time=self.time[rows],
            omega=self.omega[rows, i],
            pose=self.pose[rows, i],
            command=self._command[rows, i],
            twist_command=_complete(self._twist_command[rows, i]),
            icr=_complete(self._icr[rows, i]),
            covariance=self._covariance[rows, i],
            valid=self._valid[rows, i],
            load=self.load[rows, i] if self._yields[i] else None,
            truth=truth,
            scans=scans,
            metadata=metadata,
        )


def _complete(values: Array) -> Array | None:
    """The values (T, ...), or None unless all of them have been recorded."""
    return None if np.isnan(values).any() else values
