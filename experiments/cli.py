"""The `trackslip` command line: options in, results out; a refused value prints a one-line error and exits with 2."""

import atexit
import contextlib
import gc
import importlib
import io
import os
import shutil
import signal
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

import tyro

from experiments.options.help import HelpBuffer, wrapped
from experiments.starting.quick_types import quick_types
from trackslip.errors import InvalidValueError, TrackslipError

_OPTIONS = {
    "reproduce": "ReproduceConfig",
    "grid": "SweepConfig",
    "wander": "WanderConfig",
    "identify": "IdentifyConfig",
    "plan": "PlanConfig",
    "deploy": "DeployConfig",
    "evaluate": "EvaluateConfig",
    "bag": "BagConfig",
    "localize": "LocalizeConfig",
    "track": "TrackConfig",
    "drive": "DriveConfig",
    "benchmark": "BenchmarkConfig",
    "train": "TrainConfig",
    "predict": "PredictConfig",
    "calibrate": "CalibrateConfig",
    "validate": "ValidateConfig",
    "coverage": "CoverageConfig",
    "sensitivity": "SensitivityConfig",
    "bench": "BenchConfig",
    "export": "ExportConfig",
    "view": "ViewConfig",
}


class Commands(Mapping[str, Any]):
    """Options by command, imported when they are asked for: those of all commands take as long as what parses them."""

    def __getitem__(self, name: str) -> Any:
        options = _OPTIONS[name]
        return getattr(importlib.import_module(f"experiments.options.{name}"), options)

    def __iter__(self) -> Iterator[str]:
        return iter(_OPTIONS)

    def __len__(self) -> int:
        return len(_OPTIONS)

    def __contains__(self, name: object) -> bool:
        return name in _OPTIONS


COMMANDS = Commands()
"""Options by command; the module experiments.commands.NAME runs it."""

EXAMPLES = (
    ("the whole paper, with a report in out/reproduce/report.html", "trackslip reproduce"),
    ("a command's options and examples", "trackslip grid --help"),
    (
        "complete commands and options with Tab in bash (or zsh, fish)",
        'eval "$(trackslip --tyro-print-completion bash)"',
    ),
)
"""What a command line does, and the line, as trackslip's own `--help` prints them."""
COMMAND_EXAMPLES = (
    ("the whole paper", "trackslip reproduce"),
    ("with other random numbers", "trackslip reproduce --seed 1 --out out/reproduce-1"),
    ("on another ground", "trackslip reproduce --ground.across 0.9 --scanner.noise 0.01"),
    ("the paper's 25 runs", "trackslip grid"),
    ("six runs of 20 s", "trackslip grid --radii 0.5 1 2 --speeds 0.1 0.2 --duration 20"),
    ("on a gravel slope", "trackslip grid --ground gravel --ground.slope 0.1 --ground.uphill 1.57"),
    ("with a noisier scanner", "trackslip grid --scanner.noise 0.01 --obstacles posts --out out/noisy"),
    ("a thousand runs", "trackslip grid --grounds stone ice --slope 0 0.05 --seeds 0 1 2 3 4 5 6 7 8 9"),
    ("over any option", "trackslip grid --vary scanner.noise=0.005,0.02 robot.half_gauge=0.15,0.2"),
    ("on a Dask cluster", "trackslip grid --sweep sweep.toml --executor dask://host:8786"),
    ("two minutes of teleoperation, poses as from SLAM", "trackslip wander"),
    ("ten drives with GNSS", "trackslip wander --drives 10 --source gnss --out out/gnss"),
    ("a late clock and a jump", "trackslip wander --source.delay 0.15 --source.jumps 1 --source.jump-size 0.5"),
    ("a minute as a ROS 2 bag, with scans", "trackslip wander --duration 60 --source scanner --bag"),
    ("exactly by a law, to check an estimate", "trackslip wander --motion law --law.offset 0.04"),
    ("from a stored grid", "trackslip identify out/grid"),
    ("from a real robot's log", "trackslip identify log.csv --half-gauge 0.168 --sprocket-radius 0.06"),
    ("from a ROS bag", "trackslip identify run.mcap --half-gauge 0.168 --sprocket-radius 0.06"),
    ("from some runs of a sweep", "trackslip identify out/grid --where ground=ice seed=0"),
    ("from a drive, with a sensor 0.3 m ahead", "trackslip identify out/wander --method drive --sensor 0.3 0 0"),
    ("as in the paper", "trackslip identify out/grid --motion paper --out out/identify-paper"),
    ("the best minute in 3 x 3 m", "trackslip plan --half-gauge 0.168 --sprocket-radius 0.06"),
    ("outdoors, with GNSS", "trackslip plan --half-gauge 0.3 --sprocket-radius 0.1 --area 12x8 --poses gnss"),
    ("where the law is least known", "trackslip plan --after out/identify --duration 30"),
    ("tried a hundred times", "trackslip plan --after out/identify --drive --repeats 100"),
    ("parameters of diff_drive_controller", "trackslip deploy out/identify"),
    ("a C header with another law", "trackslip deploy out/identify --to c --law exponential --out slip.h"),
    ("the shipped robot's law in Python", "trackslip deploy --to python --out slip.py"),
    ("a law and no compensation", "trackslip evaluate out/wander --law out/identify --law none"),
    ("on a robot's log", "trackslip evaluate log.csv --law out/mine --law none"),
    ("of two laws, on a ROS bag", "trackslip evaluate run.mcap --law out/mine:icr --law out/mine:turn_loss"),
    ("topics, and what is taken for what", "trackslip bag run.mcap"),
    ("as a log with units", "trackslip bag run.mcap --export log.parquet"),
    ("with other poses", "trackslip bag old.bag --poses tf:map:base_link --export log.csv"),
    ("a plate of 0.5 m by 2 cm", "trackslip localize run.mcap --plate 0.5x0.02"),
    ("a scanner whose place is known", "trackslip localize run.mcap --plate 0.5x0.02 --mount -1.5 -1.5 1.57"),
    ("by other poses", "trackslip localize run.mcap --plate 0.5x0.02 --poses /amcl_pose"),
    ("the paper's path and controller", "trackslip track"),
    ("without slip compensation", "trackslip track --compensation none --out out/track-none"),
    ("with online identification", "trackslip track --controller lqr --compensation online --reference slalom"),
    ("with your own laws", "trackslip track --laws out/identify --compensation exponential"),
    ("the rescue robot on stairs, flippers by reflex", "trackslip drive"),
    ("slowly over a step, with pictures", "trackslip drive --course step10 --speed 0.1 --flippers up --pictures 8"),
    ("your own robot and course, as a video", "trackslip drive --robot r.toml --course c.toml --video drive.mp4"),
    ("by the keyboard", "trackslip drive --course arena --teleop"),
    ("every controller on the paper's path", "trackslip benchmark"),
    ("Sec. IV of the paper", "trackslip benchmark --suite paper"),
    ("two controllers on ice", "trackslip benchmark --controllers linear lqr --grounds ice --seeds 0 1"),
    ("your own controller", "trackslip benchmark --controllers linear my_controller:MyController"),
    ("two million steps", "trackslip train"),
    ("resume from the last checkpoint", "trackslip train --steps 4000000 --resume"),
    ("to cross courses", "trackslip train --env traverse --out out/traverse"),
    ("a quick try", "trackslip train --steps 100000 --robots 16 --batch 512 --out out/try"),
    ("the shipped robot", "trackslip predict"),
    ("uphill on ground that shears", "trackslip predict --shear 0.01 --slope 0.17"),
    ("a robot of another size", "trackslip predict --half-gauge 0.25 --contact-length 0.6 --friction-ratio 1.2"),
    ("to the paper's slips and radii", "trackslip calibrate"),
    ("to a log, with other parameters", "trackslip calibrate --target log.csv --free friction_ratio radius_error"),
    ("the shipped robot", "trackslip validate"),
    ("a calibrated robot", "trackslip validate --robot out/calibrate/robot.toml"),
    ("tracks on terrain", "trackslip validate --terrain"),
    ("ground that shears", "trackslip validate --shear"),
    ("a thousand repeats", "trackslip coverage"),
    ("fewer", "trackslip coverage --repeats 100 --run-repeats 40 --grids 4"),
    ("laws from teleoperated drives", "trackslip coverage --drives"),
    ("the paper's grid", "trackslip sensitivity"),
    ("a smaller one", "trackslip sensitivity --radii 0.5 1.5 --speeds 0.1 0.2 --duration 20"),
    ("the simulator", "trackslip bench"),
    ("a quick look", "trackslip bench --sizes 1 64 --thread-counts 1 --seconds 5 --repeats 3"),
    ("the learning environments", "trackslip bench --env"),
    ("tracks on terrain", "trackslip bench --terrain"),
    ("ground that shears", "trackslip bench --shear"),
    ("a thousand runs, on one process and on two", "trackslip bench --grid"),
    ("fleets on an NVIDIA GPU", "trackslip bench --gpu"),
    ("every stage beside its bound", "trackslip bench --pipeline"),
    ("many robots and long runs", "trackslip bench --scale"),
    ("list the runs", "trackslip export out/grid"),
    ("write all runs as CSV", "trackslip export out/grid --csv"),
    ("write one run", 'trackslip export out/grid --csv --run "radius=0.5 speed=0.1" --out run.csv'),
    ("the first run", "trackslip view out/track"),
    ("compare two runs", 'trackslip view out/reproduce --run "linear none" --run "linear icr"'),
    ("a file for the viewer", "trackslip view log.csv --save log.rrd"),
)
"""The same for the `--help` of the command that the line starts."""

_DESCRIPTION = """Slip of tracked robots: simulate it, identify it, compensate for it.
`trackslip COMMAND --help` lists a command's options and examples."""
_REPEATABLE = (("view", "--run"), ("evaluate", "--law"))
DRAWING = ("identify", "localize", "drive", "benchmark", "validate", "sensitivity")
"""Commands whose modules import matplotlib when they are imported."""
_BRIEF = ("reproduce",)  # commands that end before their garbage matters: to free figures takes a tenth of drawing them
_COMPLETION = ("--tyro-print-completion", "--tyro-write-completion")
_SHELLS = ("bash", "zsh", "fish", "tcsh")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command; exits with 2 for a mistake in it, 130 when interrupted."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    try:
        options = parse(arguments)
        alone = not gc.isenabled()  # in a process of its own, of which nothing so far is garbage
        if alone and arguments[0] in DRAWING:
            importlib.import_module("experiments.starting.quick_matplotlib").import_matplotlib()
        runner = importlib.import_module(f"experiments.commands.{arguments[0]}")
        if alone:
            gc.freeze()
            if arguments[0] not in _BRIEF:
                gc.enable()
        with contextlib.suppress(ValueError):  # only the main thread can set handlers
            signal.signal(signal.SIGTERM, signal.default_int_handler)
            if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
                signal.signal(signal.SIGINT, signal.default_int_handler)
        runner.run(options)
        sys.stdout.flush()
        if alone:
            gc.freeze()  # the process ends: no need to look for garbage
            if arguments[0] in _BRIEF:
                _leave()
    except TrackslipError as error:
        _fail(str(error), 2)
    except KeyboardInterrupt as interrupt:
        _fail(str(interrupt) or "interrupted", 130)
    except MemoryError:
        _fail("out of memory", 2)
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):  # the reader has seen enough
            sys.exit(1)
        _fail(f"can't write ({error.strerror or error})", 2)


def _leave() -> None:
    """End the process as usual, but leave it to the system to take everything apart."""
    atexit._run_exitfuncs()
    sys.stderr.flush()
    os._exit(0)


def parse(arguments: Sequence[str]) -> Any:
    """The command's options.

    Raises:
        TrackslipError: for a value that the options refuse.
        SystemExit: after help, and for arguments that tyro rejects, once it has explained them.
    """
    _check(arguments)
    named = [name for name in COMMANDS if arguments[:1] == [name]]
    with contextlib.suppress(_NotParsedError):
        return _parsed(arguments, named or COMMANDS)
    return _parsed(arguments, COMMANDS)  # it tells which other commands have the option


class _NotParsedError(Exception):
    """Arguments that options of one command do not explain."""


def _parsed(arguments: Sequence[str], commands: Collection[str]) -> Any:
    """See `parse`; the options of some commands are known. Raises _NotParsedError for what only others may have."""
    explanation, shown = io.StringIO(), HelpBuffer()
    try:
        with contextlib.redirect_stderr(explanation), contextlib.redirect_stdout(shown), quick_types():
            return tyro.extras.subcommand_cli_from_dict(
                {name: COMMANDS[name] for name in commands},
                prog="trackslip",
                args=arguments,
                description=_DESCRIPTION,
                config=(tyro.conf.DisallowNone, tyro.conf.HelptextFromCommentsOff),
            )
    except SystemExit as stop:
        if stop.code and (refused := _refused_value(stop)):
            raise refused from None
        if stop.code and len(commands) < len(COMMANDS):
            raise _NotParsedError from None
        sys.stderr.write(explanation.getvalue())
        if stop.code or arguments[0] in _COMPLETION:
            sys.stdout.write(shown.getvalue())
        else:
            print(wrapped(shown.getvalue(), shutil.get_terminal_size().columns))
            print(examples_text("" if arguments[0].startswith("-") else arguments[0]))
        sys.stdout.flush()
        raise


def examples_of(command: str) -> tuple[tuple[str, str], ...]:
    """What each example does, and its command line; those of trackslip itself for an empty name."""
    return tuple(one for one in COMMAND_EXAMPLES if one[1].split()[1] == command) if command else EXAMPLES


def examples_text(command: str) -> str:
    """The end of a command's help; that of trackslip itself for an empty name."""
    return "\n".join(["examples:", *(f"  {line}\n      {what}" for what, line in examples_of(command))])


def _refused_value(stop: SystemExit) -> InvalidValueError | None:
    """The options' own error if it is why tyro stops; its field is named as the option is, ground.across."""
    cause = stop.__context__
    if cause is None or not isinstance(cause.__context__, InvalidValueError):
        return None
    refused = cause.__context__
    group = str(getattr(cause, "arg", "")).partition(".")[2]
    return InvalidValueError(f"{group}.{refused.field}", refused.value, refused.allowed) if group else refused


def _check(arguments: Sequence[str]) -> None:
    """Raise TrackslipError for arguments that tyro would accept silently, or reject with a traceback."""
    if arguments[:1] and not arguments[0].startswith("-") and arguments[0] not in COMMANDS:
        raise InvalidValueError("COMMAND", arguments[0], f"one of {', '.join(COMMANDS)}")
    if arguments[:1] and arguments[0] in _COMPLETION and arguments[1:2] and arguments[1] not in _SHELLS:
        raise InvalidValueError(arguments[0], arguments[1], f"one of {', '.join(_SHELLS)}")
    given: set[str] = set()
    option = "trackslip"
    for argument in arguments:
        if not argument or (argument.startswith("--") and argument.endswith("=")):
            raise InvalidValueError(argument.removesuffix("=") or option, "", "non-empty")
        if any("\ud800" <= character <= "\udfff" for character in argument):
            raise InvalidValueError(option, argument, "valid UTF-8")
        if argument.startswith("--"):
            option = argument.partition("=")[0].replace("_", "-")
            switch = option.replace("--no-", "--", 1)
            if switch in given and (arguments[0], option) not in _REPEATABLE:
                raise TrackslipError(f"{option} is given twice; give it once, with all its values")
            given.add(switch)


def _fail(message: str, code: int) -> None:
    line = "".join(c if c.isprintable() else "?" for c in " ".join(message.split()))
    print(f"trackslip: {line}", file=sys.stderr)
    sys.exit(code)


if __name__ == "__main__":
    _fail("start it as `trackslip` or `python -m experiments`", 2)
