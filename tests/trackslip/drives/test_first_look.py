import json

import numpy as np
import pytest
from plain_drives import (
    DRIVE,
    ENCODER_STEP,
    HUSKY,
    KINDS,
    POSE,
    TIME,
    Drive,
    Robot,
    drive_of,
    holds,
    log_of,
    look,
    look_at,
    measured,
    without,
)

from trackslip import se2
from trackslip.drives.conditioning import drives_of
from trackslip.drives.drive import Drives
from trackslip.drives.first_look import first_look
from trackslip.drives.gains import gains_of, windows_of
from trackslip.errors import LogError
from trackslip.se2 import Mounting, wrap_angle

SMALL = Robot(0.1, 0.04, 0.03)
LARGE = Robot(1.0, 0.3, 0.6)
SKIDDING = Robot(0.25, 0.1, 0.4)


def require_gain(gain, truth):
    """Assert that a gain holds the truth, or is unknown where the truth is None."""
    if truth is None:
        assert gain is None
    else:
        assert holds(gain, truth)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("robot", "driving", "poses"),
    [
        (HUSKY, {}, {}),
        (HUSKY, {"slip": 0.05}, {"pose_step": 1.0, "position_noise": 0.02}),
        (SMALL, {"speed": 0.2, "yaw_rate": 0.6}, {"position_noise": 0.002}),
        (
            LARGE,
            {"speed": 2.0, "yaw_rate": 0.5, "slip": 0.05},
            {"pose_step": 0.2, "position_noise": 0.02},
        ),
        (SKIDDING, {"speed": 3.0, "yaw_rate": 1.0}, {"pose_step": 0.2}),
    ],
)
def test_clean_logs_have_no_alarm_and_gains_that_hold_the_truth(robot, driving, poses, kind):
    drive = drive_of(robot, seed=3, **driving)
    time, pose = measured(drive, **poses)
    found = look(log_of(drive, time, without(pose, kind)), robot=robot)
    assert found.alarms == ()
    assert holds(found.gains.turn, robot.turn_gain)
    require_gain(found.gains.speed, None if kind == "headings" else 1 + robot.radius_error)
    assert abs(found.clock) < 0.08
    assert len(found.drives) == 1
    words = {
        "poses": "poses",
        "positions": "positions without headings",
        "headings": "headings without positions",
    }
    assert found.notes[0].startswith(f"{words[kind]} every")
    assert json.dumps(found.to_json(), allow_nan=False)


def test_constant_speeds_are_no_repeated_readings():
    """Exact encoders on 20 squares, with a pose at the beginning and the end of each."""
    speed = np.tile([0.5, 0.0], 80)
    yaw_rate = np.tile([0.0, np.pi / 8], 80)
    aside = HUSKY.half_gauge * yaw_rate
    omega = np.column_stack([speed - aside, speed + aside]) / HUSKY.radius
    time = np.arange(0.0, 640.0, 0.1)
    command = np.minimum((time / 4).astype(int), len(omega) - 1)
    encoders = Drive(time, omega[command], np.zeros((len(time), 3)))
    path = drive_of(duration=640.0, commands=(speed, yaw_rate))
    ends = np.arange(0, len(path.time), 1600)
    found = look_at(encoders, path.time[ends], path.pose[ends])
    (check,) = [check for check in found.checks if check.subject == "times of encoder readings"]
    assert check.line == "the sprockets turn at constant speeds"
    assert not found.alarms


def test_noisy_poses_are_said_to_be_noisy():
    """Positions alone, whose noise is larger than the motion between them."""
    time, pose = measured(DRIVE, pose_step=1.0, position_noise=0.8)
    found = look_at(DRIVE, time, without(pose, "positions"))
    lines = [check.line for check in found.checks]
    assert "the poses hardly follow the wheels" in lines
    assert "the motion hardly varies" not in lines


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("speeds", "yaw_rates", "tells"),
    [
        ([0.5, -0.3], [0.0, 0.0], "speed"),
        ([0.0, 0.0], [0.6, -0.6], "turn"),
        ([0.5, 0.5], [0.4, 0.4], "both"),
    ],
)
def test_plain_driving_tells_what_it_can(speeds, yaw_rates, tells, kind):
    drive = drive_of(commands=(np.tile(speeds, 20), np.tile(yaw_rates, 20)))
    time, pose = measured(drive, position_noise=0.03, heading_noise=0.03)
    found = look_at(drive, time, without(pose, kind))
    assert found.alarms == ()
    tells_turn = tells in ("turn", "both") and not (tells == "turn" and kind == "positions")
    tells_speed = tells in ("speed", "both") and kind != "headings"
    require_gain(found.gains.turn, HUSKY.turn_gain if tells_turn else None)
    require_gain(found.gains.speed, 0.97 if tells_speed else None)


@pytest.mark.parametrize(
    ("left", "right", "side"), [(20, 0, "left"), (1, 19, "right"), (3, 17, None), (10, 10, None)]
)
def test_a_tenth_of_all_turns_is_needed_to_the_other_side(left, right, side):
    """Each turn takes 4 s at 0.4 rad/s, after 4 s straight ahead."""
    turns = np.repeat([0.4, -0.4], [left, right])
    yaw_rates = np.column_stack([np.zeros(20), turns]).ravel()
    drive = drive_of(duration=160.0, commands=(np.full(40, 0.5), yaw_rates))
    found = look_at(drive, *measured(drive))
    assert found.left_turns == pytest.approx(1.6 * left, rel=0.02, abs=0.05)
    assert found.right_turns == pytest.approx(1.6 * right, rel=0.02, abs=0.05)
    assert found.turns_to_one_side == (side is not None)
    notes = [note for note in found.notes if note.startswith("turns to the")]
    told = f"turns to the {side} only: unequal sides and turns can't be told apart"
    assert notes == ([] if side is None else [told])


def test_a_robot_that_does_not_turn_has_no_turns_to_both_sides():
    drive = drive_of(commands=(np.tile([0.5, -0.3], 20), np.zeros(40)))
    found = look_at(drive, *measured(drive))
    assert found.left_turns == found.right_turns == 0.0
    assert found.turns_to_one_side


@pytest.mark.parametrize(("interval", "compared"), [(10.0, True), (10.02, False)])
def test_poses_are_compared_up_to_ten_seconds_apart(interval, compared):
    drive = drive_of(duration=300.0, yaw_rate=0.1)
    time, pose = measured(drive, pose_step=interval)
    drives, _ = drives_of([log_of(drive, time, pose)])
    window = windows_of(Drives.of(drives), HUSKY.geometry, 0.0)
    assert np.isfinite(window.turned).any() == compared


def test_spins_of_a_sensor_far_ahead_are_no_jumps():
    """In windows of 2 s, the robot drives 0.2 m or moves its sensor by 0.8 m; 6 m are a jump."""
    spins = np.tile([1.0, 0.0, -1.0, 0.0], 10)
    drive = drive_of(commands=(np.where(spins == 0, 0.1, 0.0), spins), duration=160.0, hold=4.0)
    pose = drive.pose.copy()
    pose[:, 0] += 0.5 * np.cos(pose[:, 2])
    pose[:, 1] += 0.5 * np.sin(pose[:, 2])

    def known_motions(pose):
        drives, _ = drives_of([log_of(drive, drive.time, pose)])
        return np.isfinite(windows_of(Drives.of(drives), HUSKY.geometry, 0.0).moved)

    assert known_motions(pose).all()
    pose[len(pose) // 2 :, 1] += 6.0
    assert np.sum(~known_motions(pose)) == 1


def gains_at(drive, mount, unit=1.0):
    """Gains of a drive, measured by a sensor at a pose (x, y, phi) in the robot, with positions in
    units of 1 / `unit` m.
    """
    time, pose = measured(drive, position_noise=0.001, heading_noise=0.001)
    seen = se2.compose(pose, np.array(mount))
    seen[:, :2] *= unit
    drives, _ = drives_of([log_of(drive, time, seen)])
    return gains_of(Drives.of(drives), HUSKY.geometry, 0.0)


@pytest.mark.parametrize("unit", [1.0, 1000.0])
@pytest.mark.parametrize(
    ("mount", "speed", "heading"),
    [((0.3, -0.2, 0.4), 0.97, 0.4), ((-0.5, 0.1, -2.0), -0.97, np.pi - 2.0)],
    ids=["ahead", "backwards"],
)
def test_gains_come_with_where_the_sensor_is_mounted(mount, speed, heading, unit):
    """Also in mm. If a sensor looks backwards, the wheels seem to count backwards: the robot's
    frame is the one turned by half a turn, in which the sensor looks ahead.
    """
    found = gains_at(drive_of(), mount, unit)
    assert holds(found.turn, HUSKY.turn_gain)
    assert found.speed.value == pytest.approx(unit * speed, rel=1e-3)
    assert found.heading == pytest.approx(heading, abs=1e-3)
    place = complex(*mount[:2]) * np.sign(speed)
    assert found.arm == pytest.approx(unit * place, rel=1e-3)


def test_on_a_circle_a_place_counts_as_a_gain():
    """A point at x + i y moves at v + (i x - y) w, always the same there."""
    circle = drive_of(commands=(np.full(30, 0.5), np.full(30, 0.4)))
    found = gains_at(circle, (0.3, 0.2, 0.0))
    motion = 0.97 * (0.5 + (0.3j - 0.2) * 0.4) / 0.5
    assert found.speed.value == pytest.approx(abs(motion), rel=1e-3)
    assert found.heading == pytest.approx(-np.angle(motion), abs=1e-3)
    assert abs(found.arm) < 1e-6


@pytest.mark.parametrize(
    ("speeds", "yaw_rates", "note"),
    [
        ([0.5, -0.3], [0.0, 0.0], "no gain of turns: the robot hardly turns"),
        ([0.0, 0.0], [0.6, -0.6], "no gain of distances: the robot hardly drives"),
    ],
)
def test_a_gain_that_is_missing_has_a_reason(speeds, yaw_rates, note):
    drive = drive_of(commands=(np.tile(speeds, 20), np.tile(yaw_rates, 20)))
    assert note in look_at(drive, *measured(drive)).notes


def test_a_sensor_anywhere_and_turned_changes_no_gain():
    heading = POSE[:, 2]
    arm = np.exp(1j * heading) * (0.4 - 0.2j)
    pose = np.column_stack([POSE[:, 0] + arm.real, POSE[:, 1] + arm.imag, heading + 1.2])
    found = look_at(pose=pose)
    assert holds(found.gains.speed, 0.97)
    assert found.gains.arm == pytest.approx(0.4 - 0.2j, abs=0.01)
    assert found.gains.heading == pytest.approx(1.2, abs=0.01)


def test_stops_and_rare_motion_are_no_missing_readings():
    """Encoders at 1 Hz of a robot that stops and goes, and a robot that stands for most of an
    hour.
    """
    v = np.tile([0.5, 0.0], 60)
    w = np.tile([0.3, 0.0], 60)
    drive = drive_of(commands=(v, w), hold=2.0, duration=240.0)
    rows = slice(None, None, 50)
    angle = np.cumsum(drive.omega * ENCODER_STEP, axis=0)
    slow = Drive(drive.time[rows], np.diff(angle[rows], axis=0, prepend=0.0), drive.pose[rows])
    slow.omega[np.abs(slow.omega) < 0.1] = 0.0
    turn = look_at(slow, *measured(drive)).gains.turn
    assert turn.value == pytest.approx(HUSKY.turn_gain, rel=0.03)

    # hardly logged at first, but without a gap
    rare = np.arange(DRIVE.time[-1] + 5, 1500.0, 5.0)
    often = np.arange(1500.0, 3000.0, 0.02)
    rest = np.concatenate([rare, often, [3000.0]])
    noise = np.random.default_rng(0).normal(0, 1e-3, (len(rest), 2))
    still = Drive(
        time=np.concatenate([DRIVE.time, rest]),
        omega=np.concatenate([DRIVE.omega, noise]),
        pose=DRIVE.pose,
    )
    assert holds(look_at(still).gains.turn, HUSKY.turn_gain)


@pytest.mark.parametrize(
    ("kind", "late"), [("poses", 6.0), ("positions", -30.0), ("headings", 112.0), ("poses", 1.7e9)]
)
def test_clocks_that_are_far_apart_are_told(kind, late):
    whose = "encoder" if late < 0 else "pose"
    said = rf"the clocks differ by {abs(late):.1f} s, as the {whose} clock .* {whose}s"
    with pytest.raises(LogError, match=said):
        look_at(time=TIME + late, pose=without(POSE, kind))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("late", [-0.3, 1.9])
def test_clocks_that_are_nearly_right_give_a_start_value(late, kind):
    found = look_at(time=TIME + late, pose=without(POSE, kind))
    assert found.clock == pytest.approx(-late, abs=0.05)
    assert found.alarms == ()


@pytest.mark.parametrize("pose_step", [0.1, 2.0])
def test_positions_of_a_robot_that_reverses_tell_its_clocks(pose_step):
    """Its speed is the same either way, so only its course tells; it turns by half a circle where
    the robot reverses.
    """
    yaw_rates = np.random.default_rng(1).uniform(-0.6, 0.6, 50)
    drive = drive_of(commands=(np.tile([0.5, -0.5], 25), yaw_rates), hold=8.0, duration=400.0)
    time, pose = measured(drive, pose_step=pose_step)
    found = look_at(drive, time + 0.7, without(pose, "positions"))
    assert found.clock == pytest.approx(-0.7, abs=0.05)


def test_a_run_with_another_clock_offset_is_reported():
    late = {"a": 0.0, "b": 0.4, "c": 1e-3}
    logs = [log_of(DRIVE, TIME - offset, POSE, run=name) for name, offset in late.items()]
    told = "run 'b': add 0.40 s to the times of its poses: other runs have other clocks"
    assert [note for note in look(*logs).notes if "clocks" in note] == [told]


def test_poses_of_another_drive_are_not_a_matter_of_clocks():
    time, pose = measured(drive_of(seed=10))
    assert [alarm.kind for alarm in look_at(DRIVE, time, pose).alarms] == ["match"]
    said = r"encoders .* and poses \(1000 to 1120 s\) don't overlap: subtract"
    with pytest.raises(LogError, match=said):
        look_at(DRIVE, time + 1000.0, pose)


def test_the_same_round_again_is_no_other_clock():
    v = np.tile([0.5, 0.5, 0.0, 0.0], 8)
    w = np.tile([0.0, 0.4, 0.4, 0.0], 8)
    drive = drive_of(commands=(v, w))
    assert abs(look_at(drive, *measured(drive)).clock) < 0.05


@pytest.mark.parametrize("kind", ["poses", "positions"])
@pytest.mark.parametrize(
    ("rows", "offset", "parts", "told"),
    [
        pytest.param(
            slice(600, 601), 3.0, 1, "1 wild pose left out, first at t = 60 s", id="one pose"
        ),
        pytest.param(
            slice(600, 602), 3.0, 1, "2 wild poses left out, first at t = 60 s", id="two poses"
        ),
        pytest.param(
            slice(600, None), 30.0, 2, "1 lasting jump of its poses, first at t = 60 s", id="jump"
        ),
        pytest.param(
            slice(0, 2), -10.0, 1, "1 lasting jump of its poses, first at t = 0.2 s", id="start"
        ),
    ],
)
def test_jumps_are_left_out_or_cut(rows, offset, parts, told, kind):
    pose = without(POSE, kind)
    pose[rows, 0] += offset
    found = look_at(pose=pose)
    assert holds(found.gains.turn, HUSKY.turn_gain)
    (note,) = [line for line in found.notes if line.startswith("run 'a'")]
    assert note.split(": ")[1] == told
    assert found.alarms == ()
    assert len(found.drives) == parts
    for part in found.drives:
        steps = np.diff(part.pose[:, :2], axis=0)
        assert np.hypot(steps[:, 0], steps[:, 1]).max() < 0.3


def refused(match, **log):
    with pytest.raises(LogError, match=match) as caught:
        look_at(**log)
    assert 40 < len(str(caught.value)) < 320


METRES_PER_DEGREE = 111_320  # of latitude


def stacked(x, y, phi):
    return np.column_stack([x, y, phi])


def clockwise(x, y, phi):
    return stacked(x, y, np.pi / 2 - phi)


def clockwise_degrees(x, y, phi):
    return stacked(x, y, 90 - np.degrees(phi))


def part_of_quaternion(x, y, phi):
    return stacked(x, y, np.sin(phi / 2))


def millimetres_ahead(x, y, phi):
    """Of a sensor 300 mm ahead."""
    return stacked(1e3 * x + 300 * np.cos(phi), 1e3 * y + 300 * np.sin(phi), phi)


def millimetres_without_heading(x, y, phi):
    return stacked(1000 * x, 1000 * y, np.nan * phi)


def longitude_latitude(x, y, phi):
    longitude = 8.5 + x / (METRES_PER_DEGREE * np.cos(np.radians(47)))
    return stacked(longitude, 47 + y / METRES_PER_DEGREE, np.nan * phi)


def latitude_longitude(x, y, phi):
    longitude = 144 + x / (METRES_PER_DEGREE * np.cos(np.radians(-37)))
    return stacked(-37 + y / METRES_PER_DEGREE, longitude, np.nan * phi)


def longitude_latitude_heading(x, y, phi):
    longitude = 9.3 + x / (METRES_PER_DEGREE * np.cos(np.radians(52.1)))
    return stacked(longitude, 52.1 + y / METRES_PER_DEGREE, phi)


def latitude_longitude_heading(x, y, phi):
    return longitude_latitude_heading(x, y, phi)[:, [1, 0, 2]]


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (
            lambda x, y, phi: stacked(x, y, np.degrees(phi)),
            r"column phi is in degrees .*: multiply it by pi/180",
        ),
        (clockwise, "phi runs clockwise by the"),
        (clockwise_degrees, r"in degrees, clockwise .*: give pi/2 - phi pi/180"),
        (lambda x, y, phi: stacked(y, x, phi), "x and y are mirrored .*: exchange x and y"),
        (lambda x, y, phi: stacked(x, -y, phi), "x and y are mirrored .*: change the sign of y"),
        (part_of_quaternion, r"looks like the z of a quaternion: give phi ="),
        (millimetres_ahead, "like mm"),
        (millimetres_without_heading, "x and y look like mm: divide them by 1000"),
        (longitude_latitude, "look like degrees of longitude and latitude"),
        (latitude_longitude, "look like degrees of longitude and latitude"),
        (
            longitude_latitude_heading,
            "look like degrees of longitude and latitude, in either order",
        ),
        (
            latitude_longitude_heading,
            "look like degrees of longitude and latitude, in either order",
        ),
    ],
)
def test_poses_in_other_units(change, match):
    refused(match, pose=change(*POSE.T))


def test_a_sensor_known_to_look_backwards_is_no_mistake():
    backwards = POSE + np.array([0.0, 0.0, np.pi])
    refused("or turn phi by pi", pose=backwards)
    sensor = Mounting(-0.1, 0.0, np.pi)
    drives = drives_of([log_of(DRIVE, TIME, backwards)])[0]
    seen = first_look(drives, HUSKY.geometry, sensor)
    plain = look_at()
    assert seen.gains.speed == pytest.approx(plain.gains.speed)
    assert [check.verdict for check in seen.checks] == [check.verdict for check in plain.checks]
    # fits get the headings as logged
    turned = plain.drives[0].pose + np.array([0.0, 0.0, np.pi])
    np.testing.assert_allclose(wrap_angle(seen.drives[0].pose - turned), 0.0, atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_encoders_without_sign_are_an_alarm(seed):
    drive = drive_of(seed=seed)
    time, pose = measured(drive)
    right = look_at(drive, time, pose)
    assert "signs" not in [alarm.kind for alarm in right.alarms]
    unsigned = look_at(drive.with_wheels(np.abs(drive.omega)), time, pose)
    alarm = next(alarm for alarm in unsigned.alarms if alarm.kind == "signs")
    assert "do the encoders count without sign?" in alarm.line


@pytest.mark.parametrize("aside", [0.0, 0.3, -0.3])
def test_arcs_forwards_alone_need_no_signs(aside):
    v = np.tile([0.4, 0.5], 20)
    w = np.tile([0.6, -0.6], 20)
    drive = drive_of(commands=(v, w), duration=80.0)
    time, pose = measured(drive)
    pose[:, 0] -= aside * np.sin(pose[:, 2])
    pose[:, 1] += aside * np.cos(pose[:, 2])
    assert (drive.omega >= 0).all()
    assert "signs" not in [alarm.kind for alarm in look_at(drive, time, pose).alarms]


def test_changes_of_angles_are_no_angles():
    """Without rounding, only the poses tell, of a robot that stops now and then."""
    rng = np.random.default_rng(3)
    stops = np.tile([1.0, 1.0, 0.0], 10)
    v = stops * rng.uniform(-0.6, 0.8, 30)
    w = stops * rng.normal(0, 0.6, 30)
    drive = drive_of(commands=(v, w))
    time, pose = measured(drive)
    angles = np.cumsum(drive.omega, axis=0) * ENCODER_STEP
    changes = np.diff(angles, axis=0, prepend=angles[:1])
    as_angles = np.diff(changes, axis=0, prepend=changes[:1]) / ENCODER_STEP
    refused(
        "the columns of ticks or angles look like changes since .*: give their running sums",
        drive=drive.with_wheels(as_angles),
        time=time,
        pose=pose,
    )


@pytest.mark.parametrize("factor", [4.0, 2.0, 0.5])
def test_ticks_per_turn_that_are_wrong_are_an_alarm(factor):
    alarms = look_at(drive=DRIVE.with_wheels(factor * DRIVE.omega)).alarms
    alarm = next(alarm for alarm in alarms if alarm.kind == "units")
    assert "the ticks per turn" in alarm.line


def test_degrees_are_no_unit_of_the_wheels():
    """By headings in degrees, distances may be as short as for speeds in deg/s."""
    robot = Robot(half_gauge=0.42, radius=0.11, offset=0.09, radius_error=0.025)
    drive = drive_of(robot, speed=1.1, yaw_rate=0.7)
    time, pose = measured(drive)
    refused(
        "column phi is in degrees",
        drive=drive,
        time=time,
        pose=pose * [1, 1, 180 / np.pi],
        robot=robot,
    )


def angles(omega: np.ndarray) -> np.ndarray:
    return np.cumsum(omega * ENCODER_STEP, axis=0)


def counts(omega: np.ndarray, per_turn: int = 2048) -> np.ndarray:
    return np.floor(angles(omega) * per_turn / (2 * np.pi))


def ticks(drive: Drive, per_turn: int, wraps: int = 0) -> np.ndarray:
    """Speeds by a counter with ticks; one of so many steps is not unwrapped."""
    count = counts(drive.omega, per_turn)
    if wraps:
        count = count % wraps
    change = np.diff(count, axis=0, prepend=0.0)
    return change * 2 * np.pi / per_turn / ENCODER_STEP


def every_fourth_alone(omega: np.ndarray) -> np.ndarray:
    is_read = np.arange(len(omega)) % 4 == 0
    return omega * is_read[:, None]


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda w: w * HUSKY.radius, "look like m/s: divide them by sprocket_radius = 0.165 m"),
        (
            lambda w: w * HUSKY.radius * 1000,
            "look like mm/s: divide them by sprocket_radius = 165 mm",
        ),
        (lambda w: np.degrees(w), "look like deg/s"),
        (lambda w: w * 60 / (2 * np.pi), "look like rpm"),
        (
            lambda w: w / (2 * np.pi),
            "look like turns per second: .*, or omega_l and omega_r look like m/s",
        ),
        (angles, r"look like angles or ticks \(up to .*\), not speeds"),
        (lambda w: (angles(w) + np.pi) % (2 * np.pi) - np.pi, "look like angles"),
        (counts, "look like angles or ticks"),
        (lambda w: (counts(w) + 2**15) % 2**16 - 2**15, "look like angles or ticks"),
        (lambda w: counts(w) % 2048, "look like angles or ticks"),
        (every_fourth_alone, "columns omega_l and omega_r go to 0 and back .* times"),
    ],
)
def test_readings_of_encoders_that_are_no_speeds(change, match):
    refused(match, drive=DRIVE.with_wheels(change(DRIVE.omega)))


def test_counts_since_the_last_reading_are_an_alarm():
    changes = np.diff(counts(DRIVE.omega, 500), axis=0, prepend=0.0)
    found = look_at(DRIVE.with_wheels(changes))
    assert "omega_l and omega_r are whole numbers" in found.alarms[0].line


def test_a_counter_that_begins_anew():
    refused(
        r"column omega_. is .* rad/s at t = .* its usual speed",
        drive=DRIVE.with_wheels(ticks(DRIVE, 400, 4096)),
    )


@pytest.mark.parametrize("per_turn", [60, 4096])
def test_counters_with_few_or_many_ticks_pass(per_turn):
    found = look_at(DRIVE.with_wheels(ticks(DRIVE, per_turn)))
    assert holds(found.gains.turn, HUSKY.turn_gain)
    assert found.alarms == ()


@pytest.mark.parametrize("every", [5, 50])
def test_zeros_for_missing_poses(every):
    pose = np.zeros((len(DRIVE.time), 3))
    pose[::every] = POSE[:: every // 5]
    refused(
        "columns x, y and phi go to 0 and back .* times: leave cells empty",
        time=DRIVE.time,
        pose=pose,
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda w: w[:, ::-1],
            ": exchange omega_l and omega_r, or change the signs of y and phi if phi",
        ),
        (lambda w: w * [-1, 1], ": change the sign of omega_l, for a bag by --reversed left$"),
        (lambda w: w * [1, -1], ": change the sign of omega_r, for a bag by --reversed right$"),
        (lambda w: -w, ": change the sign of omega_l and omega_r, for a bag by --reversed both$"),
        (lambda w: -w[:, ::-1], r"or turn phi by pi \(--sensor X Y 3.14159 if the sensor"),
    ],
)
@pytest.mark.parametrize("jump", [0.0, 30.0])
def test_sides_that_are_swapped_or_reversed(change, words, jump):
    jumped = POSE + jump * (TIME > 60.0)[:, None] * [1, 1, 0]
    refused(words, drive=DRIVE.with_wheels(change(DRIVE.omega)), pose=jumped)


@pytest.mark.parametrize("kind", ["positions", "headings"])
def test_without_whole_poses_there_are_two_ways_to_swap_sides(kind):
    words = "exchange omega_l and omega_r, or change the signs of both if they count backwards"
    refused(words, drive=DRIVE.with_wheels(DRIVE.omega[:, ::-1]), pose=without(POSE, kind))
