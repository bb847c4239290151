import mujoco
import numpy as np
import pytest

from sim import Command, Traverse, build_tracked, load_tracked, scripted
from sim.robot.tracked_model import FlipperGeometry
from sim.terrain import Course, Flat, Ramp, Step
from sim.tracks import Belts
from sim.traverse.outcome import ContactPoints, Limits, Outcome, StuckWatch
from sim.traverse.policy import PUSH, REACH, SAMPLES, TOLERATED, reflex, reflex_angles
from trackslip.errors import InvalidValueError

LEVEL = Course((Flat(4.0),), friction=0.7)


def weight_of(world):
    """Of each of its robots [N]."""
    return 9.81 * world.tracked.model.body_subtreemass[world.tracked.body]


def without_flippers(speed):
    """A command to robots without flippers at belt speeds (N, 2)."""
    return Command(np.array(speed), np.zeros((len(speed), 0)))


@pytest.fixture(scope="module")
def rescue():
    """A rescue robot under way on level ground."""
    world = Traverse(load_tracked("rescue"), [LEVEL], threads=1)
    for _ in range(25):
        world.step(Command(np.full((1, 2), 0.3), np.full((1, 4), 0.6)))
    return world


def test_straight_on_nothing_slips_and_the_load_is_the_weight(rescue):
    contact = rescue.contact
    assert contact.load.sum() == pytest.approx(weight_of(rescue), rel=2e-3)
    np.testing.assert_array_equal(contact.touching[0], [True, True, False, False, False, False])
    assert np.abs(contact.slip[0, :2]).max() < 2e-3
    assert np.isnan(contact.slip[0, 2:]).all()
    assert np.abs(rescue.work).sum() < 0.2
    assert rescue.state.velocity[0, 0] == pytest.approx(0.3, rel=2e-3)
    angles = rescue.tracked.flipper_angles(rescue.state.qpos)
    np.testing.assert_allclose(angles[0], 0.6, atol=0.03)


def test_work_lifts_the_robot_up_a_ramp():
    slope = 0.25
    course = Course((Ramp(slope, 4.0),), friction=0.9, start_length=1.0)
    world = Traverse(load_tracked("box"), [course], threads=1)
    world.begin([0], start=[[0.6, 0.0, 0.0]])
    command = without_flippers([[0.3, 0.3]])
    for _ in range(20):
        world.step(command)
    height = world.state.position[0, 2]
    work = 0.0
    for _ in range(20):
        world.step(command)
        work += world.work.sum()
    # what is lost in sliding is the slip's share of the work
    lifted = weight_of(world) * (world.state.position[0, 2] - height)
    assert work * (1 - world.contact.slip.mean()) == pytest.approx(lifted, rel=0.01)
    # of the preset: the most by which the load's shift to the rear may tilt the robot at either end
    sink = 0.0015
    tilt = 2 * sink / world.tracked.robot.contact_length
    assert world.state.pitch[0] == pytest.approx(slope, abs=tilt)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 0.0, -0.5])
@pytest.mark.parametrize("name", ["top_speed", "period", "sample", "size"])
def test_numbers_of_a_world_that_make_no_sense_are_refused(name, value):
    with pytest.raises(InvalidValueError, match=f"{name} = {value}: must be"):
        Traverse(load_tracked("box"), [LEVEL], threads=1, **{name: value})


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 0.0, -0.5])
def test_a_mass_that_makes_no_sense_is_refused(value):
    world = Traverse(load_tracked("box"), [LEVEL], threads=1)
    with pytest.raises(InvalidValueError, match=f"mass = {value}: must be"):
        world.begin([0], mass=value)


def test_traction_and_load_are_means_of_the_period():
    """Together their impulses are the momentum that a robot gains: forwards by its belts, none by
    landing.
    """
    courses = [Course((Flat(8.0),))]
    command = without_flippers([[0.4, 0.4]])
    for period, sample, drop in ((0.1, 0.02, 0.0), (0.2, 0.2, 0.005)):
        world = Traverse(load_tracked("box"), courses, threads=1, period=period, sample=sample)
        world.batch.qpos[:, 2] += drop
        weight = weight_of(world)
        mass = weight / 9.81
        forwards = 0.0
        upwards = 0.0
        work = 0.0
        for _ in range(round(2.0 / period)):
            world.step(command)
            contact = world.contact
            forwards += contact.traction.sum() * period
            upwards += (contact.load.sum() - weight) * period
            work += world.work.sum()
        assert forwards == pytest.approx(mass * world.state.velocity[0, 0], rel=0.005)
        assert upwards == pytest.approx(0.0, abs=0.005 * weight * 2.0)
        assert work > 0.5 * mass * 0.4**2  # belts that slide lose some


def test_flippers_touch_from_above_and_reach_down_behind():
    hinges = np.array([[0.2, 0.0, 0.08], [-0.2, 0.0, 0.08]])
    shape = FlipperGeometry(
        hinge=hinges,
        length=np.full(2, 0.25),
        radius=np.full(2, 0.05),
        front=np.array([True, False]),
        rest=np.zeros(2),
        aside=np.zeros(2),
    )
    up = np.full((1, 2), 0.08)
    far = SAMPLES[0] * 0.25
    for height in (0.0, 0.1, 0.3):
        ground = np.tile([height, 0.0, 0.0], (1, 2, 1))
        angle = reflex_angles(ground, np.zeros(1), up, shape)[0, 0]
        # distance of the point at `far` from the line through the hinge
        away = -far * np.sin(angle) + (height - 0.08) * np.cos(angle)
        assert away == pytest.approx(-0.05) if height else angle == 0
        tilted = reflex_angles(ground, np.full(1, 0.2), up, shape)[0, 0]
        assert tilted == pytest.approx(angle - 0.2) or height == 0.0
    pitch = np.array([-0.4, 0.0, 0.4])
    rear = reflex_angles(np.zeros((3, 2, 3)), pitch, np.full((3, 2), 0.08), shape)[:, 1]
    assert -REACH <= rear[0] < -0.3
    assert rear[0] < rear[1] < 0
    assert rear[2] == pytest.approx(-PUSH * (0.4 - TOLERATED))  # it pushes what leans back


@pytest.mark.parametrize(("slope", "pitch"), [(-0.1, 0.4), (0.0, 0.4), (0.2, 0.4), (0.2, 0.3)])
def test_rear_flippers_push_against_what_no_slope_explains(slope, pitch):
    """A robot that points upwards by a pitch on an even slope [rad]."""
    front = np.array([True, True, False, False])
    outwards = np.where(front, 1.0, -1.0)
    hinges = np.column_stack([0.2 * outwards, np.tile([0.15, -0.15], 2), np.full(4, 0.08)])
    shape = FlipperGeometry(
        hinge=hinges,
        length=np.full(4, 0.25),
        radius=np.full(4, 0.05),
        front=front,
        rest=np.full(4, 0.1),
        aside=np.zeros(4),
    )
    x = hinges[:, :1] + outwards[:, None] * SAMPLES * 0.25
    ground = 0.1 + np.tan(slope) * x[None]  # so high that they needn't reach down to it
    rear = reflex_angles(ground, np.full(1, pitch), np.full((1, 4), 0.08), shape)[0, 2:]
    unexplained = max(pitch - slope - TOLERATED, 0.0)
    np.testing.assert_allclose(rear, -PUSH * unexplained - 0.1)


def test_flippers_feel_the_ground_under_them_that_courses_have():
    course = Course((Ramp(0.3, 4.0),), start_length=3.0)
    world = Traverse(load_tracked("rescue"), [course], threads=1)
    # it stands level and looks along x, its flippers over the ramp
    world.state.position[0, 0] = -0.38
    shape = world.flippers
    hinge = world.state.position[0] + shape.hinge
    forwards = np.where(shape.front, 1, -1)
    reach = SAMPLES * shape.length[:, None]
    x = hinge[:, :1] + forwards[:, None] * reach
    ground = course.height(x, hinge[:, 1:2])
    expected = reflex_angles(ground[None], np.zeros(1), hinge[None, :, 2], shape)
    np.testing.assert_allclose(reflex(world), expected, atol=1e-3)
    assert expected[0, shape.front].min() > 0.05
    world.begin([0], start=[[-0.38, 0.0, 0.0]])  # above all that they reach over
    highest = course.height(world.footprint.ahead - 0.38, 0.0)
    assert world.state.position[0, 2] > highest > 0.04


def test_the_scripted_controller_comes_back_to_the_middle():
    world = Traverse(load_tracked("rescue"), [Course((Flat(3.0),))], 2, threads=1)
    world.begin([0, 1], start=[[-1.0, 0.3, 0.3], [-1.0, -0.3, -0.3]])
    for _ in range(80):
        world.step(scripted(world))
    places = world.state.position[:, :2]
    assert np.abs(places[:, 1]).max() < 0.05
    np.testing.assert_allclose(places[0], places[1] * [1, -1], atol=1e-6)


def test_commands_and_starts_that_make_no_sense_are_refused(rescue):
    fine = np.zeros((1, 2))
    flippers = np.zeros((1, 4))
    said = r"speed = \[\[0.1, nan\]\]: must be finite, of shape \(1, 2\)"
    for command, message in (
        (Command(np.array([[0.1, np.nan]]), flippers), said),
        (Command(np.zeros(2), flippers), "speed"),
        (Command(fine, np.zeros((1, 3))), "flippers"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            rescue.step(command)
    for start in ([[0.0, np.nan, 0.0]], [[0.0, 0.0]], np.zeros((2, 3))):
        with pytest.raises(InvalidValueError, match="start"):
            rescue.begin([0], start=start)


@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_forces_of_a_standing_robot_add_up_to_its_weight(speed):
    world = build_tracked(load_tracked("box"))
    model = world.model
    data = mujoco.MjData(model)
    belts = Belts(model)
    belts.set(np.full(2, speed))
    for _ in range(1000):
        mujoco.mj_step(model, data)
    points, forces = ContactPoints(world).at(data.qpos, data.qvel, np.full(2, speed), np.zeros(0))
    assert len(points) > 10
    np.testing.assert_allclose(forces.sum(axis=0), [0, 0, 9.81 * 25], atol=0.5)
    assert (forces[:, 2] > 0).all()
    np.testing.assert_allclose(np.abs(points[:, 1]), 0.17, atol=1e-6)
    np.testing.assert_allclose(points[:, 2], 0.0, atol=1e-3)
    assert belts.read(data).load.sum() == pytest.approx(forces[:, 2].sum(), rel=1e-3)


WALL = Course((Flat(0.2), Step(0.6)), friction=0.5, start_length=1.4, goal_length=1.4)
ROWS = ("reached", "stuck", "fell", "tipped", "exploded", "time")


@pytest.fixture(scope="module")
def world():
    """A box in every row, each driven or put to another end."""
    limits = Limits(time=6.0, stuck_time=2.0)
    world = Traverse(load_tracked("box"), [WALL], len(ROWS), limits=limits, threads=1)
    start = np.tile([-0.6, 0.0, 0.0], (len(ROWS), 1))
    start[0] = WALL.goal - 0.1, 0.0, 0.0
    start[2] = -0.6, 1.3, np.pi / 2
    world.begin(np.arange(len(ROWS)), start=start)
    on_its_back = np.array([np.cos(0.7), np.sin(0.7), 0.0, 0.0])
    world.batch.qpos[3, 2:7] = 0.4, *on_its_back
    world.batch.qvel[4, 2] = 50.0
    speed = np.full((len(ROWS), 2), 0.5)
    speed[5] = -0.02, 0.02
    while (world.outcome == Outcome.DRIVING).any():
        world.step(Command(speed, np.zeros((len(ROWS), 0))))
    return world


def test_each_run_ends_by_name_and_stands_still(world):
    assert tuple(Outcome(one).label for one in world.outcome) == ROWS
    contact = world.contact
    for values in (
        world.state.qpos,
        world.state.qvel,
        contact.traction,
        contact.load,
        contact.depth,
        world.work,
    ):
        assert np.isfinite(values).all()
    qpos = world.state.qpos.copy()
    time = world.time.copy()
    world.step(without_flippers(np.ones((len(ROWS), 2))))
    np.testing.assert_array_equal(world.state.qpos, qpos)
    np.testing.assert_array_equal(world.time, time)
    assert world.time[5] == pytest.approx(6.0)


def test_a_state_that_is_not_finite_is_named_and_kept_out(capfd, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    world = Traverse(load_tracked("box"), [WALL], 2, threads=1)
    fine = world.state.qpos[1].copy()
    gravity = world.batch.expand("opt.gravity")
    gravity[1, 2] = np.nan
    world.step(without_flippers(np.zeros((2, 2))))
    assert [Outcome(one).label for one in world.outcome] == ["driving", "exploded"]
    np.testing.assert_array_equal(world.state.qpos[1], fine)
    gravity[1, 2] = gravity[0, 2]
    world.begin([1])
    world.step(without_flippers(np.zeros((2, 2))))
    assert (world.outcome == Outcome.DRIVING).all()
    # no MUJOCO_LOG.TXT of the engine's
    assert capfd.readouterr().err == ""
    assert [*tmp_path.iterdir()] == []
    assert mujoco.MjLogConfig.get().logto_file  # as before


def test_a_period_in_which_a_run_diverges_has_no_work():
    world = Traverse(load_tracked("box"), [LEVEL], 2, threads=1)
    command = Command(np.full((2, 2), 0.3), np.zeros((2, 0)))
    world.step(command)
    assert (np.abs(world.work) > 0).all()
    world.batch.expand("opt.gravity")[1, 2] = np.nan
    world.step(command)
    assert world.outcome[1] == Outcome.EXPLODED
    assert np.abs(world.work[0]).min() > 0
    np.testing.assert_array_equal(world.work[1], 0.0)


PAIR = """<mujoco><worldbody><body name="base">
<geom name="hull" type="box" size=".2 .1 .05" pos="0 0 .1" mass="9"/>
<body name="arm" pos="0 0 .3"><joint axis="0 1 0" range="-9 9"/>
<geom name="arm" size=".05" mass="1"/></body></body></worldbody>
<contact><pair geom1="hull" geom2="arm" friction="0.11 0.12 0 0 0"/></contact></mujoco>"""


def test_a_models_own_contact_pair_keeps_its_friction(tmp_path):
    (tmp_path / "robot.xml").write_text(PAIR)
    (tmp_path / "robot.toml").write_text(
        'model = "robot.xml"\nhalf_gauge = 0.3\nhull = [[-0.2, 0.0, 0.1], [0.2, 0.0, 0.1]]\n'
    )
    slippery = Course((Flat(4.0),), friction=0.4)
    robot = load_tracked(tmp_path / "robot.toml")
    for courses in ([LEVEL], [LEVEL, slippery]):
        world = Traverse(robot, courses, 1, threads=1)
        world.begin([0], [courses[-1]])
        model = world.tracked.model
        friction = world.batch.expand("pair_friction")[0, :, :2]
        hull = model.geom("hull").id
        arm = model.geom("arm").id
        first = min(hull, arm)
        second = max(hull, arm)
        own = (model.pair_geom1 == first) & (model.pair_geom2 == second)
        assert own.sum() == 1
        np.testing.assert_array_equal(friction[own], [[0.11, 0.12]])
        assert (friction[~own] == courses[-1].friction).all()


def test_who_waits_turns_or_slips_is_not_stuck():
    watch = StuckWatch(Limits(stuck_time=1.0), 4, period=0.1)
    position = np.zeros((4, 3))
    belts = np.array([[0.0, 0.0], [-0.3, 0.3], [0.3, 0.3], [0.3, 0.3]])
    speed = np.array([0.0, 0.0, 0.05, 0.02])  # at a tenth of the belts' way a robot is stuck
    found = []
    for _ in range(12):
        position[:, 0] += speed * 0.1
        found.append(watch.observe(position, belts))
    np.testing.assert_array_equal(found[-1], [False, False, False, True])
    assert not np.any(found[:10])
    watch.begin(np.array([3]))
    assert not watch.observe(position, belts).any()
