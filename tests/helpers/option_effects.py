"""For each command a base case, and for each of its options a change that has an effect.

An entry has the words that are added to the command line, where {name} is one of the files below.
Words before a bar are a context: without them the option is refused. An entry that begins with ~
gives the reason why an option doesn't change results.
"""

import contextlib
import dataclasses
import io
import json
import os
import re
import shlex
import typing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import tyro

from experiments.cli import config_module, main
from trackslip.laws.file import SHIPPED

SPEED = "~ it only changes how long the command takes"
PLACE = "~ it only says where results are written"
FIGURES = "~ it writes figures a second time, which tests of pages check"
CONSENT = "~ it lets a law with an alarm pass, which tests of deploy check"
SCREEN = "~ it opens a window"
MEMORY = "~ it only refuses logs, which tests of trackslip.logs and bags check"
WAIT = "~ it only waits for the workers of a cluster, which tests of the pool check"
PICTURES = "~ it needs OpenGL; tests of drive check it"
RESUMED = "~ tests of train check it"
FOUND = "~ no robot is lost on so short a path; tests of the closed loop check it"
LOOPS = "~ tune drives the closed loops of benchmark, whose table has it"

RESULTS = {"out": PLACE, "overwrite": PLACE}
EQUIPMENT = RESULTS | {
    "robot": "--robot {robot}",
    "radius_error": "--radius-error 0.02",
    "drive.lag": "--drive.lag 0.2",
    "drive.top_speed": "--drive.top-speed 0.4",
    "drive.torque_limit": "--drive.torque-limit 2",
    "drive.encoder_counts": "--drive.encoder-counts 200",
    "drive.period": "--drive.period 0.005",
    "drive.motor.gear": "--drive.motor.gear 30",
    "drive.motor.no_load_speed": "--drive.motor.no-load-speed 250",
    "drive.motor.stall_torque": "--drive.motor.stall-torque 0.2",
    "drive.motor.rotor_inertia": "--drive.motor.rotor-inertia 0.0005",
    "drive.motor.friction": "--drive.motor.friction 2",
    "pull.force": "--pull 20",
    "pull.height": "--pull 20 | --pull.height 0.3",
    "pull.since": "--pull 20 | --pull.since 2",
}
SCANS = {
    "scanner.field_of_view": "--scanner.field-of-view 2",
    "scanner.resolution": "--scanner.resolution 0.02",
    "scanner.rate": "--scanner.rate 10",
    "scanner.noise": "--scanner.noise 0.02",
    "scanner.max_range": "--scanner.max-range 2.3",
    "scanner.dropout": "--scanner.dropout 0.2",
    "scanner.quantisation": "--scanner.quantisation 0.02",
    "scanner.range_bias": "--scanner.range-bias 0.02",
    "obstacles": "--obstacles occluded",
}
GROUND = {
    "ground.source": "--ground ice",
    "ground.along": "--ground.along 0.5",
    "ground.across": "--ground.across 0.9",
    "ground.slope": "--ground.slope 0.1",
    "ground.uphill": "--ground.slope 0.1 | --ground.uphill 1",
    "ground.shear": "--ground.shear 0.02",
}
EVEN_GROUND = GROUND | {
    "ground.slope": "~ always refused: the ground is level",
    "ground.uphill": "~ always refused: the ground is level",
}
SIMULATION = EQUIPMENT | GROUND | {"seed": "--seed 1", "threads": SPEED, "rrd": "--rrd"}
GRID = (
    SIMULATION
    | SCANS
    | {
        "radii": "--radii 0.6 1.5",
        "speeds": "--speeds 0.2 0.25",
        "localization": "--localization line",
        "duration": "--duration 5",
        "motion": "--motion paper",
        "random_phase": "--random-phase",
    }
)
CLOSED_LOOPS = (
    EQUIPMENT
    | SCANS
    | {
        "drive.top_speed": "--drive.top-speed 0.2",
        "obstacles": "~ none hides the plate on so short a path; the table of track has it",
        "localization": "--localization truth",
        "preview": "--preview 0.1",
        "command_delay": "--command-delay 0.1",
        "when_lost": FOUND,
        "laws": "--compensations icr_radius | --laws {laws}",
    }
)
NO_BAG = {
    f"bag.{name}": "~ always refused: the log is no bag; tests of trackslip.bags check it"
    for name in ("encoders", "left", "right", "reversed", "poses", "imu", "plate", "scan")
}
NO_LAYOUT = {
    f"table.{name}": "~ the log has the documented columns; tests of trackslip.logs check it"
    for name in ("columns", "ticks_per_turn", "odom_half_gauge", "odom_radius")
}


@dataclass(frozen=True)
class Case:
    """A command line, and its options with words that change the result."""

    line: str
    options: dict[str, str]
    more: dict[str, str] = field(default_factory=dict)
    """Words that are refused on this line, by the option that the message names."""


CASES = {
    "grid": Case(
        "grid --radii 0.5 --speeds 0.25 --duration 4 --executor inline --threads 1",
        GRID
        | {
            "grounds": "--grounds ice stone",
            "seeds": "--seeds 0 1",
            "vary": "--vary scanner.noise=0.01,0.02",
            "sweep": "--sweep {sweep}",
            "executor": SPEED,
            "jobs": SPEED,
            "wait": WAIT,
            "bag": "--bag",
            "pdf": FIGURES,
        },
    ),
    "reproduce": Case(
        "reproduce --radii 0.5 1.5 --speeds 0.1 0.25 --duration 6 --threads 1",
        GRID | {"pdf": FIGURES},
    ),
    "track": Case(
        "track --start 0 0.1 1.5 --reference {bend} --threads 1",
        SIMULATION
        | SCANS
        | {
            "drive.top_speed": "--drive.top-speed 0.19",
            "obstacles": "--obstacles {post}",
            "command_delay": "--command-delay 0.1",
            "when_lost": FOUND,
            "controller": "--controller feedforward",
            "compensation": "--compensation none",
            "preview": "--preview 0.1",
            "localization": "--localization truth",
            "reference": "--reference {straight}",
            "circle_radius": "--reference circle --circle-duration 5 | --circle-radius 2",
            "circle_speed": "--reference circle --circle-duration 5 | --circle-speed 0.1",
            "circle_duration": "--reference circle | --circle-duration 5",
            "speed": "--speed 0.2",
            "tolerance": "--reference {steps} | --reference {steps} --tolerance 0.03",
            "start": "--start 0 0.2 0",
            "laws": "--laws {laws}",
            "bag": "--bag",
            "pdf": FIGURES,
        },
        {
            "speed": "--reference circle --speed 0.1",
            "tolerance": "--reference circle --tolerance 0.03",
            "scanner.noise": "--localization truth --scanner.noise 0.02",
            "obstacles": "--localization truth --obstacles posts",
            "laws": "--compensation none --laws {laws}",
            "circle_radius": "--reference slalom --circle-radius 2",
            "circle_speed": "--circle-speed 0.2",
        },
    ),
    "wander": Case(
        "wander --duration 8 --driving stop_and_go --threads 1",
        SIMULATION
        | {
            "driving": "--driving eights",
            "drives": "--drives 2",
            "duration": "--duration 9",
            "max_speed": "--max-speed 0.2",
            "acceleration": "--acceleration 0.3",
            "encoder_rate": "--encoder-rate 25",
            "source.source": "--source mocap",
            "source.rate": "--source.rate 20",
            "source.position_noise": "--source.position-noise 0.1",
            "source.heading_noise": "--source.heading-noise 0.1",
            "source.heading": "--source.no-heading",
            "source.delay": "--source.delay 0.2",
            "source.jitter": "--source.jitter 0.01",
            "source.outliers": "--source.outliers 0.1",
            "source.gaps": "--source.gaps 1",
            "source.gap_duration": "--source.gaps 1 | --source.gap-duration 2",
            "source.jumps": "--source.jumps 1",
            "source.jump_size": "--source.jumps 1 | --source.jump-size 1",
            "source.drift": "--source.drift 0.1",
            "source.ahead": "--source.ahead 0.2",
            "source.left": "--source.left 0.2",
            "source.mounting": "--source.mounting 0.3",
            "bag": "--bag",
            "pdf": FIGURES,
        },
        {
            "source.heading_noise": "--source gnss --source.heading-noise 0.1",
            "source.mounting": "--source gnss --source.mounting 0.1",
        },
    ),
    "drive": Case(
        "drive --course rough --duration 1",
        RESULTS
        | {
            "robot": "--robot box",
            "course": "--course step10",
            "difficulty": "--course rails | --difficulty 0.9",
            "speed": "--speed 0.2",
            "turn": "--turn 0.5",
            "path": "--path {bend}",
            "flippers": "--flippers up",
            "preset": "--preset fast",
            "friction": "--friction 0.3",
            "duration": "--duration 2",
            "seed": "--seed 1",
            "policy": "~ tests of train check it",
            "pictures": PICTURES,
            "check": "~ it needs that everything else is left out; tests of drive check it",
        },
        {"course": "--check"},
    ),
    "predict": Case(
        "predict",
        RESULTS
        | {
            "turns": "--turns 10 --measured 8",
            "drove": "--drove 10 --measured 8",
            "measured": "--turns 10 --measured 8",
            "unit": "--turns 10 --measured 8 | --unit rad",
            "multiplier": "--turns 10 --measured 8 | --multiplier 1.2",
            "robot": "--robot husky",
            "half_gauge": "--half-gauge 0.2",
            "contact_length": "--contact-length 0.5",
            "ground": "--ground gravel",
            "friction_ratio": "--friction-ratio 1.3",
            "friction": "--slope 0.1 | --friction 0.5",
            "shear": "--shear 0.02",
            "slope": "--slope 0.1",
            "uphill": "--slope 0.1 | --uphill 1",
            "pull": "--pull 20",
            "pull_height": "--pull 20 | --pull-height 0.4",
            "com_x": "--com-x 0.05",
            "sprocket_radius": "--sprocket-radius 0.05",
            "radius_error": "--radius-error 0.02",
            "radii": "--radii 1 2",
        },
        {
            "radii": "--turns 10 --measured 8 --radii 1 2",
            "slope": "--turns 10 --measured 8 --slope 0.1",
        },
    ),
    "plan": Case(
        "plan --half-gauge 0.168 --sprocket-radius 0.06 --duration 30",
        RESULTS
        | {
            "half_gauge": "--half-gauge 0.2",
            "sprocket_radius": "--sprocket-radius 0.05",
            "max_speed": "--max-speed 0.2",
            "acceleration": "--acceleration 0.3",
            "area": "--area 2x2",
            "clearance": "--clearance 0.5",
            "duration": "--duration 32",
            "poses": "--poses gnss",
            "law": "--law turn_loss",
            "offset": "--offset 0.1",
            "doubt": "--doubt 0.5",
            "after": "~ tests of plan check it",
            "seed": "~ a search as short as in tests finds the same drive with any seed",
            "bag": "--no-bag",
            "topic": "--topic /base/cmd_vel",
            "pdf": FIGURES,
        },
        {"topic": "--no-bag --topic /base/cmd_vel"},
    ),
    "identify": Case(
        "identify {grid}",
        RESULTS
        | NO_BAG
        | NO_LAYOUT
        | {
            "logs": "~ the log",
            "where": "~ tests of identify check it",
            "half_gauge": "--half-gauge 0.2",
            "sprocket_radius": "--sprocket-radius 0.05",
            "gear": "--gear 1.1",
            "multiplier": "--multiplier 1.02",
            "method": "--method drive",
            "sensor": "--sensor 0.1 0 0",
            "motion": "--motion paper",
            "settle": "--settle 2",
            "lag": "--lag",
            "all": "--all",
            "max_memory": MEMORY,
            "pdf": FIGURES,
        },
        {
            "sensor": "--method steady --sensor 0.1 0 0",
            "lag": "--method steady --lag",
            "motion": "--method drive --motion arc",
            "settle": "--method drive --settle 2",
        },
    ),
    "evaluate": Case(
        "evaluate {wander} --law {laws}",
        RESULTS
        | NO_BAG
        | NO_LAYOUT
        | {name: f"--robot shipped | {words}" for name, words in GROUND.items()}
        | {
            "logs": "~ the log",
            "law": "--law none",
            "robot": "--robot shipped",
            "ground.uphill": "--robot shipped --ground.slope 0.1 | --ground.uphill 1",
            "inputs": "--robot shipped | --inputs commands",
            "folds": "--folds 2",
            "free": "--robot shipped --folds 2 | --free friction_ratio",
            "half_gauge": "~ it must be that of the laws; tests of evaluate check it",
            "sprocket_radius": "~ it must be that of the laws; tests of evaluate check it",
            "gear": "--gear 2",
            "multiplier": "--multiplier 1.2",
            "sensor": "--sensor 0.1 0 0",
            "clock_offset": "--clock-offset 0.3",
            "max_memory": MEMORY,
            "rrd": "--rrd",
            "pdf": FIGURES,
        },
    ),
    "calibrate": Case(
        "calibrate --threads 1",
        RESULTS
        | NO_BAG
        | NO_LAYOUT
        | EVEN_GROUND
        | {
            "target": "--target {samples}",
            "free": "--free friction_ratio",
            "robot": "--robot {robot}",
            "gear": "--target {samples} | --gear 1.05",
            "sensor": "--target {samples} | --sensor 0.3 0.1 0.1",
            "clock_offset": "--target {wander} --free friction_ratio | --clock-offset 0.3",
            "folds": "--target {samples} | --folds 2",
            "test": "--target {samples} | --test {samples}",
            "max_memory": MEMORY,
            "threads": SPEED,
            "pdf": FIGURES,
        },
        {
            "ground.slope": "--ground.slope 0.1",
            "ground.uphill": "--ground.uphill 0.1",
            "ground.changes": "--ground sticky",
            "clock_offset": "--target {samples} --clock-offset 0.1",
            "encoders": "--target {samples} --encoders /a",
            "bag.encoders": "--encoders /a",
            "max_memory": "--max-memory 8GB",
        },
    ),
    "validate": Case(
        "validate --threads 1",
        RESULTS
        | EVEN_GROUND
        | {"seed": "--seed 1", "threads": SPEED, "robot": "--robot {robot}", "pdf": FIGURES},
        {"ground.slope": "--ground.slope 0.1", "ground.changes": "--ground sticky"},
    ),
    "benchmark": Case(
        "benchmark --controllers linear --compensations none --references {bend} --starts paper "
        "--grounds stone --seeds 0 --jobs 1",
        CLOSED_LOOPS
        | {
            "suite": "--suite paper",
            "controllers": "--controllers lqr",
            "compensations": "--compensations icr_radius",
            "references": "--references {straight}",
            "speed": "--speed 0.1",
            "tolerance": "--references {steps} | --references {steps} --tolerance 0.03",
            "grounds": "--grounds ice",
            "starts": "--starts zero",
            "seeds": "--seeds 1",
            "plants": "--plants nominal",
            "gains": "--gains default",
            "jobs": SPEED,
            "pdf": FIGURES,
        },
        {
            "scanner.noise": "--localization truth --scanner.noise 0.02",
            "speed": "--references slalom --speed 0.1",
            "tolerance": "--references slalom --tolerance 0.03",
        },
    ),
    "tune": Case(
        "tune linear --compensations none --evaluations 12 --threads 1",
        CLOSED_LOOPS
        | dict.fromkeys((*EQUIPMENT, *SCANS), LOOPS)
        | {
            "controllers": "~ words without an option, which tests of tune give",
            "compensations": "--compensations icr_radius",
            "evaluations": "--evaluations 24",
            "roughness": "--roughness 0.05",
            "seeds": "--seeds 1",
            "seed": "--seed 1",
            "threads": SPEED,
        },
        {"scanner.noise": "--localization truth --scanner.noise 0.02"},
    ),
    "train": Case(
        "train --robots 4 --horizon 32 --batch 64 --epochs 1 --network 8 --references slalom "
        "--steps 256 --threads 1",
        RESULTS
        | {
            "env": "~ tests of train check it",
            "pdf": FIGURES,
            "steps": "--steps 384",
            "robots": "--robots 8",
            "references": "--references circle",
            "grounds": "--grounds ice",
            "compensation": "--compensation none",
            "authority": "--authority 0.05 0.3",
            "robot": "--robot {robot}",
            "laws": "--laws {laws}",
            "courses": "~ it needs --env traverse; tests of train check it",
            "difficulty": "~ it needs --env traverse; tests of train check it",
            "trials": "~ it needs --env traverse; tests of train check it",
            "network": "--network 16",
            "learning_rate": "--learning-rate 0.01",
            "horizon": "--horizon 64",
            "batch": "--batch 32",
            "epochs": "--epochs 2",
            "discount": "--discount 0.9",
            "seed": "--seed 1",
            "threads": SPEED,
            "resume": RESUMED,
            "own_rewards": RESUMED,
        },
        {"laws": "--compensation none --laws {laws}", "courses": "--courses rails"},
    ),
    "deploy": Case(
        "deploy",
        {
            "path": "{laws}",
            "to": "--to c",
            "law": "--law icr",
            "controller": "--controller mine",
            "accept": CONSENT,
            "out": PLACE,
            "overwrite": PLACE,
        },
        {"controller": "--to c --controller mine", "overwrite": "--overwrite"},
    ),
    "log": Case(
        "log {samples}",
        NO_BAG
        | NO_LAYOUT
        | {"path": "~ the log", "out": PLACE, "overwrite": PLACE, "max_memory": MEMORY},
    ),
    "view": Case(
        "view {wander} --save x.rrd",
        NO_LAYOUT
        | {
            "path": "~ the log",
            "run": "~ tests of recordings check it",
            "robot": "~ tests of recordings check it",
            "web": SCREEN,
            "save": PLACE,
            "max_memory": MEMORY,
        },
        {"web": "--web"},
    ),
}
QUICK = ("predict", "deploy")
"""Commands whose whole table is tried in seconds."""


def option_names(cls: Any, prefix: str = "") -> set[str]:
    """The options of a command, with those in groups behind dots."""
    names: set[str] = set()
    hints = typing.get_type_hints(cls, include_extras=True)
    for each in dataclasses.fields(cls):
        hint = hints[each.name]
        if tyro.conf.Suppress in getattr(hint, "__metadata__", ()):
            continue
        kind = getattr(hint, "__origin__", hint)
        inner = dataclasses.is_dataclass(kind)
        names |= option_names(kind, f"{prefix}{each.name}.") if inner else {prefix + each.name}
    return names


def options_of(command: str) -> set[str]:
    """All options of a command."""
    return option_names(config_module(command).Config)


def write_inputs(folder: Path) -> dict[str, str]:
    """Paths that the table names, by the name in braces, with all files but those that are
    driven.
    """
    laws = json.loads(Path(SHIPPED).read_text())
    for law in laws["slip_laws"].values():
        law["values"] = {name: 1.1 * value for name, value in law["values"].items()}
    rng = np.random.default_rng(0)
    omega = rng.uniform(1, 5, (30, 2))
    sum_and_difference = np.column_stack([omega.sum(axis=1), omega[:, 1] - omega[:, 0]])
    exact = np.array([0.0297, 0.1409]) * sum_and_difference
    twist = exact + 0.001 * rng.standard_normal((30, 2))
    np.savetxt(
        folder / "samples.csv",
        np.column_stack([omega, twist]),
        delimiter=",",
        header="omega_l,omega_r,v,w",
        comments="",
    )
    texts = {
        "laws.json": json.dumps(laws),
        "bend.csv": "x,y\n0,0\n0.7,0.1\n1.4,0.45\n",
        "straight.csv": "x,y\n0,0\n0.7,0.1\n1.4,0.2\n",
        "steps.csv": "x,y\n" + "".join(f"{k // 2 / 10},{k % 2 / 25}\n" for k in range(30)),
        # between the scanner and the middle of the bend
        "post.toml": "[[posts]]\nx = -0.4\ny = -0.7\n",
        "robot.toml": "mass = 30.0\ncontact_length = 0.3\n[drive]\nlag = 0.1\n",
        "sweep.toml": "seed = [0, 1]\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    names = (*texts, "samples.csv", "grid", "wander")
    return {name.partition(".")[0]: str(folder / name) for name in names}


def outcome(line: str, folder: Path) -> tuple[int, object, str]:
    """Exit code, results and error message of a command that is run in a new folder.

    Results are what was printed, without times, and the files, without what only repeats the
    options: manifests, pages, metadata and ids.
    """
    folder.mkdir()
    printed = io.StringIO()
    errors = io.StringIO()
    code = 0
    here = Path.cwd()
    os.chdir(folder)
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(errors):
            try:
                main(shlex.split(line))
            except SystemExit as stop:
                code = int(stop.code or 0)
    finally:
        os.chdir(here)
    files = {
        str(file.relative_to(folder)): _content(file)
        for file in sorted(folder.rglob("*"))
        if file.is_file() and file.name not in ("manifest.json", "report.html")
    }
    text = re.sub(r"[\d.]+ m?s\b", "", printed.getvalue())
    return code, (files, text), errors.getvalue()


def _content(file: Path) -> object:
    """What tells the content of two files of results apart."""
    if file.suffix == ".json":
        return _without_times(json.loads(file.read_text()))
    if file.suffix == ".parquet":
        table = pq.read_table(file)
        return {name: table[name].to_pylist() for name in table.column_names if name != "id"}
    if file.suffix in (".csv", ".tum", ".toml"):
        return [line for line in file.read_text().splitlines() if "made by" not in line]
    if file.name == "policy.npz":
        with np.load(file) as arrays:
            return {name: arrays[name].tolist() for name in arrays.files}
    return None


def _without_times(value: object) -> object:
    left_out = ("id", "timing", "wall_s", "steps_per_second", "found_by", "step_time", "expense")
    if isinstance(value, dict):
        return {key: _without_times(item) for key, item in value.items() if key not in left_out}
    return [_without_times(item) for item in value] if isinstance(value, list) else value
