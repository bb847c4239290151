"""Every option of every command is used by it, or refused.

Each command is run on a small example with all its options at values other than the defaults, while reads of the
options are recorded: one is used if code that isn't generic, as that which stores the options is, reads the value that
was given on the command line.
"""

import dataclasses
import json
import shlex
import shutil
import sys
import typing

import numpy as np
import pytest
from bags import in_order, joints_of, poses_of, write_bag
from beside import drive, teleoperated
from scanned import other_poses, write_session
from wandered import wandered

from experiments.cli import COMMANDS, main, parse
from trackslip.logs.logfile import write_parquet

GENERIC = ("dataclasses", "copy", "tyro", "experiments.options.checks", "experiments.storage", "experiments.sweep.plan")
"""Modules that copy, check or store all options, whatever they are; and functions that do:"""
GENERIC_FUNCTIONS = ("__post_init__", "CoverageConfig.grid", "leaves", "test_")
ROBOT = "half_gauge = 0.17\n"
SWEEP = "radius = [1.0, 1.5]\n"
TABLE = "radius,speed,observed_radius,slip_outer,slip_inner\n" + "".join(
    f"{r},0.1,{1.3 * r},0.1,-0.1\n" for r in (0.5, 1.0, 1.5)
)
KNOWN = json.dumps(
    {
        "format": 1,
        "geometry": {"half_gauge": 0.17, "sprocket_radius": 0.07},
        "slip_laws": {"icr": {"values": {"offset": 0.05}, "stderr": {"offset": 0.001}}},
    }
)

REPEATABLE = {"seed": "3", "threads": "1"}
EQUIPMENT = {
    "robot": "robot.toml",
    "radius-error": "0.01",
    "drive.lag": "0.06",
    "drive.top-speed": "0.35",
    "drive.torque-limit": "7",
    "drive.encoder-counts": "90000",
    "drive.period": "0.005",
    "drive.motor.gear": "51",
    "drive.motor.voltage": "25",
    "drive.motor.no-load-speed": "410",
    "drive.motor.stall-torque": "0.7",
    "drive.motor.rotor-inertia": "9e-6",
    "drive.motor.friction": "0.2",
    "scanner.field-of-view": "3.0",
    "scanner.resolution": "0.01",
    "scanner.rate": "25",
    "scanner.noise": "0.006",
    "scanner.max-range": "19",
    "scanner.dropout": "0.01",
    "scanner.quantisation": "0.001",
    "scanner.range-bias": "0.001",
    "scanner.divergence": "0.004",
    "scanner.scan-duration": "0.01",
    "obstacles": "room",
    "pull": "5",
    "pull.height": "0.2",
    "pull.since": "0.5",
    "rrd": "",
}
GROUND = {
    "ground": "gravel",
    "ground.along": "0.6",
    "ground.across": "0.7",
    "ground.slope": "0.01",
    "ground.uphill": "1",
    "ground.shear": "0.005",
}
SIMULATION = REPEATABLE | EQUIPMENT | GROUND
RUNS = SIMULATION | {"radii": "0.8 1.2", "speeds": "0.2 0.25", "localization": "line", "duration": "5"}
GRID = RUNS | {"motion": "arc", "random-phase": ""}
BAG = {"encoders": "/motors", "left": "x2", "right": "x1", "reversed": "both", "poses": "/slam/pose"}
SCANNED = {"plate": "0.6x0.04", "scan": "/scan", "mount": "1 2 0.5", "noise": "0.005"}
EXAMPLES = {
    "grid": (
        GRID | {"out": "a", "executor": "inline", "force": "", "bag": ""},
        {"grounds": "ice", "friction-ratio": "1.1", "slope": "0.01", "seeds": "4", "vary": "duration=5,6"}
        | {"sweep": "sweep.toml", "speeds": "0.2", "jobs": "1", "no-resume": "", "out": "b"},
    ),
    "wander": (
        REPEATABLE
        | {name: value for name, value in EQUIPMENT.items() if not name.startswith(("scanner", "obstacles"))}
        | GROUND
        | {"driving": "eights", "drives": "2", "duration": "2", "max-speed": "0.25", "acceleration": "0.4"}
        | {"encoder-rate": "25", "source": "mocap", "source.rate": "12", "out": "a", "bag": ""},
        {"motion": "law", "law.offset": "0.03", "law.radius-error": "0.01", "law.slip": "lasting"}
        | {"law.turning-centre": "0.02", "law.drift": "0.01", "law.lag": "0.1", "duration": "2"},
    ),
    "identify": (
        {"": "log.csv", "half-gauge": "0.2", "sprocket-radius": "0.07", "gear": "2", "pdf": "", "out": "a"}
        | {"sensor": "0.01 0 0"},
        {"": "sweep", "where": "seed=0", "motion": "butterworth", "settle": "0.5", "method": "steady"}
        | {"estimate-sensor": ""},
        {"": "run.mcap", "half-gauge": "0.168", "sprocket-radius": "0.06", "method": "drive"} | BAG,
        {"": "scanned.mcap", "half-gauge": "0.168", "sprocket-radius": "0.06", "method": "drive"} | SCANNED,
    ),
    "localize": (
        {"": "scanned.mcap", "encoders": "/joint_states", "left": "left_wheel_joint", "right": "right_wheel_joint"}
        | {"reversed": "both", "out": "a", "pdf": ""}
        | SCANNED,
        {"": "scanned.mcap", "plate": "0.6x0.04", "poses": "/slam/pose"},
    ),
    "bag": (
        {"": "run.mcap", "export": "a.csv", "overwrite": ""} | BAG,
        {"": "scanned.mcap", "export": "b.csv"} | SCANNED,
    ),
    "plan": (
        REPEATABLE
        | {"half-gauge": "0.17", "sprocket-radius": "0.07", "max-speed": "0.25", "acceleration": "0.4", "area": "4x3"}
        | {"clearance": "0.1", "duration": "12", "poses": "scanner", "law": "icr", "offset": "0.05", "doubt": "0.1"}
        | {"after": "known", "bag": "", "pdf": "", "out": "a"},
        {"half-gauge": "0.17", "sprocket-radius": "0.07", "duration": "20", "drive": "", "repeats": "2"}
        | {"motion": "mujoco", "threads": "1"},
    ),
    "evaluate": (
        {"": "drive.parquet", "law": "predicted", "half-gauge": "0.17", "sprocket-radius": "0.06", "gear": "2"}
        | {"sensor": "0.1 0 0", "clock-offset": "0.1", "no-tum": "", "pdf": "", "out": "a"},
        {"": "sweep", "where": "seed=0", "out": "b"},
        {"": "run.mcap", "half-gauge": "0.17", "sprocket-radius": "0.06", "out": "c"} | BAG,
        {"": "scanned.mcap", "half-gauge": "0.17", "sprocket-radius": "0.06", "out": "d"} | SCANNED,
    ),
    "track": (
        SIMULATION
        | {"controller": "lqr", "compensation": "online", "preview": "0.075", "localization": "line", "out": "a"}
        | {"reference": "circle", "circle-radius": "1.1", "circle-speed": "0.2", "circle-duration": "4"}
        | {"start": "0.1 0.2 0.3", "laws": "predicted", "bag": ""},
    ),
    "drive": (
        {"robot": "box", "course": "step10", "speed": "0.2", "turn": "0.1", "flippers": "up", "preset": "fast"}
        | {"friction": "0.6", "duration": "0.5", "seed": "3", "out": "a"},
        {"path": "way.csv", "course": "flat", "duration": "0.5", "preset": "fast"},
    ),
    "benchmark": (
        EQUIPMENT
        | {"suite": "paper", "controllers": "lqr", "compensations": "icr_radius", "references": "way.csv"}
        | {"grounds": "robot", "starts": "random", "seeds": "7", "localization": "line", "preview": "0.075"}
        | {"laws": "predicted", "jobs": "1", "pdf": "", "out": "a"},
    ),
    "predict": (
        {"robot": "robot.toml", "half-gauge": "0.2", "contact-length": "0.4", "friction-ratio": "1.1", "com-x": "0.01"}
        | {"sprocket-radius": "0.07", "radius-error": "0.01", "radii": "1 2", "out": "a"},
        {"friction": "0.6", "shear": "0.01", "slope": "0.1", "uphill": "0.2", "pull": "20", "pull-height": "0.2"}
        | {"out": "b"},
    ),
    "calibrate": (
        REPEATABLE
        | {
            "target": "table.csv",
            "free": "friction_ratio",
            "robot": "robot.toml",
            "starts": "1",
            "rrd": "",
            "out": "a",
        },
    ),
    "validate": (REPEATABLE | {"robot": "robot.toml", "rrd": "", "out": "a", "pdf": ""},),
    "coverage": (
        RUNS | {"repeats": "2", "run-repeats": "2", "grids": "1", "out": "a"},
        {"drives": "", "drive-repeats": "2"},
    ),
    "sensitivity": (GRID | {"out": "a", "pdf": ""},),
    "reproduce": (GRID | {"out": "a", "pdf": ""},),
    "bench": (
        {"sizes": "2", "thread-counts": "1", "seconds": "0.5", "repeats": "1", "seed": "3", "out": "a"},
        {"env": "", "env-size": "2", "thread-counts": "1", "seconds": "0.5", "repeats": "1"},
        {"grid": "", "grid-runs": "25", "grid-duration": "4", "thread-counts": "1"},
        {"shear": "", "sizes": "2", "thread-counts": "1", "seconds": "0.1", "repeats": "1"},
        {
            "terrain": "",
            "terrain-robot": "box",
            "terrain-sizes": "1",
            "thread-counts": "1",
            "seconds": "0.1",
            "repeats": "1",
        },
    ),
    "export": ({"": "sweep", "csv": "", "run": "radius=1.0\\ speed=0.1", "out": "a.csv", "overwrite": ""},),
    "deploy": ({"": "predicted", "to": "c", "law": "icr_radius", "out": "a.csv", "overwrite": ""},),
    "view": ({"": "sweep", "run": "radius=1.0\\ speed=0.1", "save": "a.rrd"},),
}
"""Command -> command lines that together give every option; an option without a value is a switch."""
NOT_RUN = {
    "drive": {"teleop", "video", "pictures"},  # need a display, PyAV, OpenGL
    "view": {"web"},  # opens a browser
    "validate": {"terrain", "shear"},  # take minutes; tests of their own run them
    "bench": {"gpu", "pipeline", "scale", "scale_long"},  # needs a GPU; the same
    "train": {field.name for field in dataclasses.fields(COMMANDS["train"])},  # needs PyTorch
}
SLOW = ("plan", "calibrate", "validate", "coverage", "sensitivity", "reproduce")


def leaves(options, prefix=()):
    """Path of attribute names of each option, and the class it belongs to."""
    hints = typing.get_type_hints(options)
    for field in dataclasses.fields(options):
        if dataclasses.is_dataclass(hints[field.name]):
            yield from leaves(hints[field.name], (*prefix, field.name))
        else:
            yield (*prefix, field.name), options


def classes(options):
    """The dataclasses of a command's options, nested ones included."""
    found = {cls for cls in options.__mro__ if dataclasses.is_dataclass(cls)}
    for hint in typing.get_type_hints(options).values():
        if dataclasses.is_dataclass(hint):
            found |= classes(hint)
    return found


@pytest.fixture
def reads(monkeypatch):
    """(class, field, value) of the options that code reads which isn't GENERIC."""
    found = set()

    def recording(self, name):
        value = object.__getattribute__(self, name)
        frame = sys._getframe(1)
        generic = frame.f_globals.get("__name__", "").startswith(GENERIC) or any(
            function in frame.f_code.co_qualname for function in GENERIC_FUNCTIONS
        )
        if not name.startswith("__") and not generic:
            found.add((type(self), name, repr(value)))
        return value

    for options in COMMANDS.values():
        for cls in classes(options):
            monkeypatch.setattr(cls, "__getattribute__", recording)
    return found


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder with what the command lines name."""
    folder = tmp_path_factory.mktemp("files")
    (folder / "robot.toml").write_text(ROBOT)
    (folder / "sweep.toml").write_text(SWEEP)
    (folder / "table.csv").write_text(TABLE)
    (folder / "known").mkdir()
    (folder / "known" / "summary.json").write_text(KNOWN)
    (folder / "way.csv").write_text("x,y\n0.5,0\n0.8,0.1\n1.1,0.1\n")
    twists = [(0.2, 0.1 * k) for k in (1, -1, 2, -2, 3, 4)]
    rows = "".join(f"{2 * (v - 0.25 * w) / 0.07},{2 * (v + 0.25 * w) / 0.07},{v},{w}\n" for v, w in twists)
    (folder / "a.csv").write_text("to be overwritten")
    (folder / "log.csv").write_text("omega_l,omega_r,v,w\n" + rows)
    log = wandered(duration=6.0)
    write_parquet([log], folder / "drive.parquet")
    joints = joints_of(dataclasses.replace(log, omega=-log.omega[:, ::-1]), names=("x1", "x2"), topic="/motors")
    write_bag(folder / "run", "foxglove", in_order(joints, poses_of(log)))
    driven = drive(teleoperated(np.random.default_rng(1), 10.0, 8.0), beams=121)
    write_session(folder / "scanned", "foxglove", driven, other_poses(driven))
    main(["predict", "--half-gauge", "0.17", "--out", str(folder / "predicted")])
    main(["grid", "--radii", "1", "1.5", "2", "--speeds", "0.1", "0.2", "--duration", "6", "--seeds", "0", "1",
          "--executor", "inline", "--out", str(folder / "sweep")])  # fmt: skip
    return folder


@pytest.fixture
def workplace(files, tmp_path, monkeypatch):
    """A folder of one's own with these files, to run commands in."""
    shutil.copytree(files, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)


def command_line(name, given):
    words = [name]
    for option, value in given.items():
        words += ([f"--{option}"] if option else []) + shlex.split(value)
    return words


@pytest.mark.usefixtures("few_resamples", "undrawn")
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name for name in EXAMPLES]
)
def test_every_option_is_used(name, workplace, reads):
    used = set()
    for given in EXAMPLES[name]:
        line = command_line(name, given)
        config = parse(line)
        default = {field.name: field for field in dataclasses.fields(config)}
        reads.clear()
        main(line)
        for path, owner in leaves(type(config)):
            value = config
            for part in path:
                value = object.__getattribute__(value, part)
            top = default[path[0]]
            if len(path) == 1 and repr(value) == repr(top.default):
                continue  # not given
            if path[0] in ("ground", "source"):  # groups that read their own fields: they are used as a whole
                used |= {path} if any(field == path[0] for _, field, _ in reads) else set()
            elif any(
                (field, read) == (path[-1], repr(value)) and (len(path) == 1 or issubclass(cls, owner))
                for cls, field, read in reads
            ):
                used.add(path)
    options = {path for path, _ in leaves(COMMANDS[name])}
    assert options - used - {(option,) for option in NOT_RUN.get(name, ())} == set()


def test_no_command_is_left_out():
    assert {*EXAMPLES, *NOT_RUN} == set(COMMANDS)


def test_an_option_without_use_is_found(reads):
    """The check itself: reads by generic code, and of another value, don't count."""
    config = parse(["grid", "--seed", "5"])
    dataclasses.replace(config, seed=6)

    def seeds():
        return {value for _, field, value in reads if field == "seed"}

    assert seeds() == set()
    eval("config.seed", {"config": config, "__name__": "a module"})
    assert seeds() == {"5"}


REFUSED = [
    (("track", "--circle-radius", "2"), "circle_radius = 2.0: must be left out without --reference circle"),
    (("track", "--circle-duration", "9"), "circle_duration = 9.0: must be left out without --reference circle"),
    (("track", "--compensation", "none", "--laws", "x"), "must be left out with --compensation none"),
    (
        ("benchmark", "--compensations", "none", "published", "--laws", "x"),
        "must be left out with --compensations none",
    ),
    (("bench", "--env-size", "3"), "env_size = 3: must be left out without --env"),
    (("bench", "--grid-runs", "50"), "grid_runs = 50: must be left out without --grid"),
    (("bench", "--scale-long", "1"), "scale_long = (1,): must be left out without --scale"),
    (("bench", "--scale", "--scale-long", "3"), "scale_long = 3: must be one of 1, 16, 256, 4096"),
    (("bench", "--env", "--sizes", "3"), "sizes = (3,): must be left out with --env"),
    (("bench", "--grid", "--seconds", "3"), "seconds = 3.0: must be left out with --grid"),
    (("bench", "--pipeline", "--seconds", "3"), "seconds = 3.0: must be left out with --pipeline and --scale"),
    (("bench", "--pipeline", "--scale"), "scale = True: must be left out with --pipeline"),
    (("bench", "--env", "--grid"), "grid = True: must be left out with --env"),
    (("export", "x", "--overwrite"), "overwrite = True: must be left out without --csv"),
    (("export", "x", "--out", "x.csv"), "must be left out without --csv"),
    (("grid", "--executor", "inline", "--jobs", "2"), "jobs = 2: must be left out with --executor inline"),
    (("grid", "--no-resume", "--force"), "force = True: must be left out with --no-resume"),
    (("grid", "--ground", "ice", "--grounds", "stone"), "ground = 'ice': must be left out where ground is an axis"),
    (("grid", "--seed", "1", "--seeds", "2"), "seed = 1: must be left out where seed is an axis"),
    (("grid", "--ground.slope", "0.1", "--slope", "0"), "ground.slope = 0.1: must be left out where slope is an axis"),
    (("grid", "--scanner.noise", "0.1", "--vary", "scanner.noise=0.2"), "scanner.noise = 0.1: must be left out where"),
    (("plan", "--after", "x", "--repeats", "5"), "repeats = 5: must be left out without --drive"),
    (("plan", "--after", "x", "--motion", "mujoco"), "motion = 'mujoco': must be left out without --drive"),
    (("view", "x", "--save", "x.rrd", "--web"), "web = True: must be left out with --save"),
]


@pytest.mark.parametrize(("arguments", "message"), REFUSED)
def test_an_option_without_effect_is_refused(refused, arguments, message):
    assert message in refused(*arguments)
