"""Damaged and hostile files of every kind are refused with one line, and crash nothing."""

import json
import resource
import subprocess
import sys
import tomllib
import warnings

import pytest
from mutants import mutants
from pages import ROOT
from tracked_files import ROBOT, URDF

from sim.ground.ground import load_ground
from sim.robot.named import load_parameters, load_tracked
from sim.scanner.scanner import load_obstacles
from sim.terrain import load_course
from trackslip.errors import TrackslipError

MODELS = ROOT / "models"
MEMORY = 4 * 2**30  # [bytes]
COUNT = 40  # mutants of a file
GROUND = """base = "gravel"
slope = 0.1
uphill = 1.57
shear = 0.01
patches = [{x = [0.0, 2.0], y = [-1.0, inf], along = 0.12, across = 0.12, shear = 0.01}]
changes = [{time = 20.0, along = 0.5, across = 0.7}]
"""
OBSTACLES = """posts = [{x = -1.6, y = -0.7, radius = 0.05}]
walls = [{x0 = -6.0, y0 = 8.0, x1 = 3.0, y1 = 8.0}]
"""
DRIVE = """[drive]
lag = 0.3
top_speed = 2.0
torque_limit = 120.0
encoder_counts = 4096
[drive.motor]
gear = 50.0
voltage = 24.0
stall_torque = 4.0
no_load_speed = 2000.0
rotor_inertia = 1e-4
friction = 0.1
"""
WHEELED = (MODELS / "warthog.toml").read_text()
FILES = {
    "parameters": (load_parameters, (MODELS / "maxxii.toml").read_text() + "[ground]\nalong = 0.7"),
    "wheels": (load_parameters, WHEELED),
    "drive": (load_parameters, DRIVE),
    "tracked": (load_tracked, ROBOT.replace('model = "mine.urdf"\n', 'model = "a"\n') + DRIVE),
    "ground": (load_ground, GROUND),
    "obstacles": (load_obstacles, OBSTACLES),
    **{
        name: (load_course, (MODELS / "courses" / f"{name}.toml").read_text())
        for name in ("arena", "rough", "cross_beams", "pallets", "side_slope", "gap", "ramp20")
    },
}


@pytest.fixture
def tried(tmp_path):
    """Load a file with this content; tell whether it is loaded rather than refused."""

    def tried(load, content):
        path = tmp_path / "mine.toml"
        path.write_bytes(content)
        try:
            with warnings.catch_warnings(action="ignore"):
                load(str(path))
        except TrackslipError:
            return False
        return True

    return tried


def in_list(texts):
    return "[" + ", ".join(texts) + "]"


def in_table(texts):
    """An inline table of texts by key."""
    return "{" + ", ".join(f"{key} = {text}" for key, text in texts.items()) + "}"


def written(value):
    """A value as TOML."""
    if isinstance(value, dict):
        return in_table({key: written(each) for key, each in value.items()})
    if isinstance(value, list):
        return in_list(map(written, value))
    return json.dumps(value) if isinstance(value, str | bool) else repr(value)


def variants(value):
    """The value with each of its parts replaced by hostile ones, as TOML."""
    if isinstance(value, dict):
        texts = {key: written(part) for key, part in value.items()}
        for key, part in value.items():
            for other in variants(part):
                yield in_table(texts | {key: other})
    elif isinstance(value, list):
        texts = [written(part) for part in value]
        for k, part in enumerate(value[:2]):
            for other in variants(part):
                yield in_list([*texts[:k], other, *texts[k + 1 :]])
        yield in_list([*texts, *texts[:1]])
        yield in_list(texts[1:])
    yield from ("inf", "nan", "-1e308", "1e308", "true", '"a"', "[]", "[[]]", "{}", "10000000000")


@pytest.mark.parametrize("name", FILES)
def test_every_value_of_a_settings_file_may_be_wrong(tried, name):
    load, text = FILES[name]
    table = tomllib.loads(text)
    assert tried(load, text.encode())
    texts = {key: written(value) for key, value in table.items()}
    for key, value in table.items():
        for other in variants(value):
            changed = texts | {key: other}
            lines = [f"{name} = {each}\n" for name, each in changed.items()]
            tried(load, "".join(lines).encode())


@pytest.mark.parametrize("name", FILES)
def test_mutants_of_settings_files_are_loaded_or_refused(tried, name):
    load, text = FILES[name]
    loaded = [tried(load, content) for content in mutants(text, COUNT, seed=1)]
    assert not all(loaded)


BUILD = """
import sys, warnings
from pathlib import Path
from sim import build_tracked, load_tracked
from trackslip.errors import TrackslipError
warnings.simplefilter("ignore")
for folder in sorted(Path(sys.argv[1]).iterdir()):
    print(folder.name, flush=True)
    try:
        build_tracked(load_tracked(folder / "robot.toml"))
    except TrackslipError as error:
        assert len(str(error).splitlines()) == 1
"""


@pytest.mark.parametrize("kind", ["mjcf", "urdf"])
def test_mutants_of_models_are_built_or_refused_without_a_crash(tmp_path, kind):
    """In a process of its own, which a crash would end."""
    name = "mine.urdf"
    text = URDF
    robot = ROBOT
    if kind == "mjcf":
        name = "box_robot.xml"
        text = (MODELS / name).read_text()
        robot = (MODELS / "box_robot.toml").read_text()
    for k, content in enumerate(mutants(text, COUNT, seed=2)):
        folder = tmp_path / f"{k:03}"
        folder.mkdir()
        (folder / name).write_bytes(content)
        (folder / "robot.toml").write_text(robot)
    done = subprocess.run(
        [sys.executable, "-c", BUILD, str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=120,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY)),
        cwd=ROOT,
    )
    assert done.returncode == 0, done.stdout.splitlines()[-1:]
    assert done.stderr == "", done.stdout.splitlines()[-1:]
    assert len(done.stdout.splitlines()) >= COUNT
