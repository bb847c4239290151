import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from pages import ROOT
from tracked_files import ROBOT

from sim import Drive, Ground
from sim.ground.ground import NAMED_GROUNDS, load_ground
from sim.motors.motor import Motor, tireless
from sim.robot.named import load_parameters, load_tracked
from sim.robot.parameters import RobotParameters, robot_file_text
from sim.scanner.scanner import Obstacles, Post, Wall, load_obstacles
from sim.terrain import Course, Rough, Stairs, load_course
from trackslip.errors import InvalidValueError, SettingsFileError

PAGE = ROOT / "docs" / "grounds_and_robots.md"
MODELS = ROOT / "models"
OBSTACLES = """posts = [{x = 1, y = 2.0}]
walls = [{x0 = 0.0, y0 = 0.0, x1 = 1.0, y1 = 0.0}]
"""
COURSE = """width = 2
friction = 0.5
seed = 7
start_length = 3.0
pieces = [
  {kind = "stairs", rise = -0.1, number = 3, width = inf},
  {kind = "rough", amplitude = 0.05},
]
"""


def test_files_hold_all_fields(tmp_path):
    path = tmp_path / "any.toml"
    path.write_text(OBSTACLES)
    expected = Obstacles((Post(1.0, 2.0),), (Wall(0.0, 0.0, 1.0, 0.0),))
    assert load_obstacles(str(path)) == expected
    path.write_text(COURSE)
    pieces = (Stairs(-0.1, number=3), Rough(amplitude=0.05))
    course = Course(pieces, width=2.0, friction=0.5, seed=7, start_length=3.0)
    assert load_course(str(path)) == course
    assert load_course(str(path), seed=8) == dataclasses.replace(course, seed=8)

    drive = Drive(lag=0.07, motor=Motor(friction=0.2))
    parameters = RobotParameters(
        half_gauge=0.12, contact_length=0.2, com_x=0.01, mass=9.0, drive=drive
    )
    ground = Ground(0.5, 0.6)
    path.write_text(robot_file_text(parameters, ground, "made by hand"))
    assert load_parameters(path) == (parameters, ground)

    box = (MODELS / "box_robot.toml").read_text().replace('"box_', f'"{MODELS}/box_')
    path.write_text(box + "[drive]\nlag = 0.2\n")
    lagging = dataclasses.replace(tireless(), lag=0.2)
    parameters, _ = load_parameters(path)
    assert parameters.drive == lagging
    assert load_tracked(path).drive == lagging


def test_the_page_lists_the_named_grounds():
    row = r"^\| `(\w+)` \| ([\d.]+) \| ([\d.]+) \| (\d+) \|"
    listed = {}
    for name, *values in re.findall(row, PAGE.read_text(), re.MULTILINE):
        listed[name] = tuple(map(float, values))
    named = {}
    for name, ground in NAMED_GROUNDS.items():
        if ground.soil is None:
            named[name] = (ground.along, ground.across, 1e3 * ground.shear)
    assert listed == named


def test_the_page_lists_the_named_soils():
    numbers = r" \| ([\d.]+)" * 6
    rows = re.findall(rf"^\| `(\w+)`{numbers} \| (?!\d)", PAGE.read_text(), re.MULTILINE)
    listed = {name: tuple(map(float, values)) for name, *values in rows}
    soils = {name: ground.soil for name, ground in NAMED_GROUNDS.items() if ground.soil}
    assert listed.keys() == soils.keys()
    for name, s in soils.items():
        moduli = (1e-3 * s.k_c, 1e-3 * s.k_phi, s.n, 1e-3 * s.cohesion)
        others = (np.degrees(s.friction_angle), 1e3 * s.shear)
        assert listed[name] == pytest.approx((*moduli, *others))


def test_a_ground_file_has_a_table_for_soil(tmp_path):
    path = tmp_path / "beach.toml"
    path.write_text('base = "dry_sand"\nslope = 0.1\n[soil]\ncohesion = 500.0\nn1 = 0.0\n')
    ground = load_ground(str(path))
    sand = NAMED_GROUNDS["dry_sand"].soil
    assert ground.slope == 0.1
    assert ground.soil.cohesion == 500.0
    assert ground.soil.k_phi == sand.k_phi
    # who gives a value no longer assumes it
    assert ground.soil.assumed == ("shear", "unit_weight")
    assert ground.soil.source == f"{sand.source}, changed in {path}"
    assert ground.shear == sand.shear
    assert ground.along == pytest.approx(np.tan(sand.friction_angle))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[soil]\nk_c = 1.0\n", "k_phi is missing"),
        ("[soil]\nk_c = 1.0\nk_phi = 2.0\nkc = 3\n", "soil: kc is unknown"),
        ("along = 0.5\n[soil]\nk_c = 1.0\nk_phi = 2e6\n", "along = 0.5: must be left out"),
        ("[soil]\nk_c = 1.0\nk_phi = 2e6\nn = -1\n", "n = -1.0: must be from 0 to 5"),
        ("soil = 3\n", "soil = 3: must be a table"),
        (
            "[soil]\nk_c = 1.0\nk_phi = 2e6\n"
            "[[patches]]\nx = [0, 1]\ny = [0, 1]\nalong = 1\nacross = 1\n",
            "patches = 1: must be left out on soft soil",
        ),
    ],
)
def test_soil_that_contradicts_or_lacks_something_is_refused(tmp_path, text, said):
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(SettingsFileError, match=re.escape(said)):
        load_ground(str(path))


def load_robot(source):
    return load_parameters(Path(source))


PIECE = "[[patches]]\ny = [0, 1]\nalong = 1\nacross = 1\n"
BLOCKS = '[[pieces]]\nkind = "blocks"\n'
LATE = "{time = 2, along = 1, across = 1}"
EARLY = "{time = 1, along = 1, across = 1}"
MISTAKES = [
    # what any file can have
    (load_ground, "along = ", "not TOML"),
    (load_ground, "a = " + "[" * 5000, "not TOML (nested too deeply)"),
    (load_ground, "along = true", "along = True: must be a number"),
    (load_ground, "grip = 1.0", "grip is unknown; known are along, across"),
    # grounds
    (load_ground, "base = 'mud'", "base = 'mud': must be one of stone"),
    (load_ground, PIECE, "patches[0]: x is missing"),
    (load_ground, PIECE + "x = [[0], [1]]", "patches[0]: x = [0]: must be a number"),
    (
        load_ground,
        f"changes = [{LATE}, {EARLY}]",
        "changes = [2.0, 1.0]: must be in ascending order",
    ),
    # robots
    (load_robot, "[drive]\nlag = 2", "drive: lag = 2.0: must be at most 1 s"),
    (load_robot, "[drive.motor]\ngear = 9.0", "drive: motor: no_load_speed is missing"),
    (load_tracked, 'model = "a.xml"\nhalf_guage = 1', "drive, offset, tracks, joints"),
    (load_tracked, "model = 3", "model = 3: must be a text"),
    (load_tracked, 'model = "a.xml"\ndrive = "strong"', "drive = 'strong': must be a table"),
    (load_tracked, ROBOT.replace("[-0.2, 0.1, 0.1], ", ""), "from 2 to 100 wheels"),
    (load_tracked, ROBOT.replace("[-0.2", '["a"'), "hull[0] = 'a': must be a number"),
    *(  # a decimal comma makes two numbers of one
        (load, ROBOT.replace("[-0.2, 0.1, 0.1]", wheel), f"hull[0] = {wheel}: must be 3 values")
        for load in (load_tracked, load_parameters)
        for wheel in ("[0, 2, 0.1, 0.1]", "[-0.2, 0.1]", "[]")
    ),
    (load_tracked, ROBOT.replace("[[-0.2, 0.1, 0.1], [0.2, 0.1, 0.1]]", "[]"), "from 2 to 100 whe"),
    (load_ground, PIECE + "x = [0, 1, 2]", "patches[0]: x = [0, 1, 2]: must be 2 values"),
    # obstacles
    (load_obstacles, "[[trees]]\nx = 1.0", "trees is unknown; known are posts, walls"),
    # courses
    (
        load_course,
        "[[pieces]]\nangle = 1",
        "pieces[0]: kind = None: must be one of flat, ramp, step, stairs",
    ),
    (load_course, BLOCKS + "blocks = [[0.5, 0, 0.1, 0.1, 0.1, 0]]", "pieces[0]: length is missing"),
]


@pytest.mark.parametrize(
    ("load", "text", "message"), MISTAKES, ids=[message[:40] for _, _, message in MISTAKES]
)
def test_a_mistake_is_one_line_with_file_and_field(tmp_path, load, text, message):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(SettingsFileError) as error:
        load(str(path))
    line = str(error.value)
    assert line.startswith(str(tmp_path))
    assert message in line
    assert "origin" not in line  # of numbers, which no file states
    assert len(line) < len(str(path)) + 200


@pytest.mark.parametrize(
    ("load", "known"),
    [
        (load_ground, "ground = .*: must be one of stone, concrete"),
        (load_obstacles, "obstacles = .*one of posts, room, occluded, or"),
        (load_course, "course = .*must be one of arena, cross_beams, .*, or a .toml file"),
        (
            load_tracked,
            r"robot = .*one of shipped, rescue, box, husky, warthog, maxxii, or a \.toml file",
        ),
    ],
)
def test_unknown_names_and_unreadable_files_are_refused(tmp_path, load, known):
    for name in ("", "mud", "x" * 5000):
        with pytest.raises(InvalidValueError, match=known):
            load(name)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "folder.toml").mkdir()
    for name, message in (
        ("none.toml", "No such file"),
        ("binary.toml", "not text"),
        ("folder.toml", "Is a directory"),
        ("x" * 5000 + ".toml", "File name too long"),
    ):
        with pytest.raises(SettingsFileError, match=message):
            load(str(tmp_path / name))


@pytest.mark.parametrize(
    ("text", "dots"),
    [
        (400_000 * "a." + "a = 1", 400_000),
        (400_000 * "1." + "1 = 1", 400_000),
        ("[" + 501 * "a . " + "a]", 501),
        ("x = {" + 501 * "'='." + "a = 1}", 501),
        (501 * "1.1 ." + "1 = 1", 1001),
    ],
)
def test_keys_with_too_many_parts_are_refused_at_once(tmp_path, text, dots):
    path = tmp_path / "any.toml"
    path.write_text(text)
    with pytest.raises(SettingsFileError) as refused:
        load_obstacles(str(path))
    assert str(refused.value) == f"{path}: {dots} dots outside of numbers, must be at most 500"


def test_a_file_may_hold_any_number_of_numbers(tmp_path):
    path = tmp_path / "any.toml"
    posts = ", ".join("{x = -1.25, y = 2.5e0}" for _ in range(600))
    path.write_text(f"posts = [{posts}]\n")
    assert len(load_obstacles(str(path)).posts) == 600
