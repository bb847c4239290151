"""`trackslip <command>`: options in, results out, one line and exit code 2 for a user's mistake."""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import signal
import sys
import typing
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Any

import tyro

from experiments.completion_config import CompletionConfig
from experiments.examples import examples_text
from experiments.mistakes import sentence
from experiments.options.bench import BenchConfig
from experiments.options.benchmark import BenchmarkConfig
from experiments.options.calibrate import CalibrateConfig
from experiments.options.coverage import CoverageConfig
from experiments.options.export import ExportConfig
from experiments.options.grid import SweepConfig
from experiments.options.identify import IdentifyConfig
from experiments.options.predict import PredictConfig
from experiments.options.reproduce import ReproduceConfig
from experiments.options.sensitivity import SensitivityConfig
from experiments.options.track import TrackConfig
from experiments.options.train import TrainConfig
from experiments.options.validate import ValidateConfig
from experiments.options.view import ViewConfig
from trackslip.errors import InvalidValueError, TrackslipError

Command = (
    Annotated[SweepConfig, tyro.conf.subcommand("grid")]
    | Annotated[IdentifyConfig, tyro.conf.subcommand("identify")]
    | Annotated[ExportConfig, tyro.conf.subcommand("export")]
    | Annotated[TrackConfig, tyro.conf.subcommand("track")]
    | Annotated[BenchmarkConfig, tyro.conf.subcommand("benchmark")]
    | Annotated[TrainConfig, tyro.conf.subcommand("train")]
    | Annotated[PredictConfig, tyro.conf.subcommand("predict")]
    | Annotated[CalibrateConfig, tyro.conf.subcommand("calibrate")]
    | Annotated[ValidateConfig, tyro.conf.subcommand("validate")]
    | Annotated[CoverageConfig, tyro.conf.subcommand("coverage")]
    | Annotated[SensitivityConfig, tyro.conf.subcommand("sensitivity")]
    | Annotated[ReproduceConfig, tyro.conf.subcommand("reproduce")]
    | Annotated[BenchConfig, tyro.conf.subcommand("bench")]
    | Annotated[CompletionConfig, tyro.conf.subcommand("completion")]
    | Annotated[ViewConfig, tyro.conf.subcommand("view")]
)
_DESCRIPTION = """Slip of tracked robots: simulate it, identify it, compensate it.
`trackslip COMMAND --help` lists a command's options, with examples."""
_RUNNERS = {
    SweepConfig: "experiments.commands.grid",
    IdentifyConfig: "experiments.commands.identify",
    ExportConfig: "experiments.commands.export",
    TrackConfig: "experiments.commands.track",
    BenchmarkConfig: "experiments.commands.benchmark",
    TrainConfig: "experiments.commands.train",
    PredictConfig: "experiments.commands.predict",
    CalibrateConfig: "experiments.commands.calibrate",
    ValidateConfig: "experiments.commands.validate",
    CoverageConfig: "experiments.commands.coverage",
    SensitivityConfig: "experiments.commands.sensitivity",
    ReproduceConfig: "experiments.commands.reproduce",
    BenchConfig: "experiments.commands.bench",
    CompletionConfig: "experiments.completion",
    ViewConfig: "experiments.commands.view",
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command; exits with 2 for a mistake in it, 130 when interrupted."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    with contextlib.suppress(ValueError):  # only the main thread may
        signal.signal(signal.SIGTERM, _terminate)
    try:
        command = parse(arguments)
        importlib.import_module(_RUNNERS[type(command)]).run(command)
        sys.stdout.flush()
    except TrackslipError as error:
        _fail(str(error), 2)
    except KeyboardInterrupt as interrupt:
        _fail(str(interrupt) or "interrupted", 130)
    except MemoryError:
        _fail("out of memory", 2)
    except BrokenPipeError:  # whoever reads has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        _fail(f"can't write ({error.strerror or error})", 2)


def parse(arguments: Sequence[str]) -> Any:
    """The command's configuration; raises TrackslipError in one line for options that are wrong."""
    _require_sense(arguments)
    try:
        with contextlib.redirect_stderr(io.StringIO()):
            return _parse(arguments)
    except SystemExit as stop:
        if stop.code != 2:
            if {"-h", "--help"} & set(arguments):
                print(examples_text("" if arguments[0].startswith("-") else arguments[0]))
            sys.stdout.flush()
            raise
    # tyro explains in a box as wide as the terminal: ask again for one wide enough to hold each sentence on a line
    box = io.StringIO()
    width = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = "2000"
    try:
        with contextlib.redirect_stderr(box), contextlib.suppress(SystemExit):
            _parse(arguments)
    finally:
        os.environ.pop("COLUMNS")
        if width is not None:
            os.environ["COLUMNS"] = width
    raise TrackslipError(sentence(box.getvalue(), arguments[0] if arguments else ""))


def _parse(arguments: Sequence[str]) -> Any:
    return tyro.cli(Command, prog="trackslip", args=arguments, description=_DESCRIPTION)


def _require_sense(arguments: Sequence[str]) -> None:
    """Raise TrackslipError for what tyro would not tell well."""
    for before, argument in pairwise(("trackslip", *arguments)):
        if not argument:
            raise InvalidValueError(before, argument, "something")
    once = {"--vary": "NAME=VALUE", "--where": "NAME=VALUE"} | (
        {"--run": "NAME"} if list(arguments[:1]) == ["export"] else {}
    )
    for option, value in once.items():
        if sum(argument.partition("=")[0] == option for argument in arguments) > 1:
            raise InvalidValueError(option, "given twice", f"given once: {option} {value} {value}")
    names = [typing.get_args(part)[1].name for part in typing.get_args(Command)]
    if arguments and not arguments[0].startswith("-") and arguments[0] not in names:
        raise InvalidValueError("COMMAND", arguments[0], f"one of {', '.join(names)}")


def _terminate(*_: object) -> None:
    raise KeyboardInterrupt


def _fail(message: str, code: int) -> None:
    line = "".join(c if c.isprintable() else "?" for c in " ".join(message.split()))
    print(f"trackslip: {line}", file=sys.stderr)
    sys.exit(code)


if __name__ == "__main__":
    main()
