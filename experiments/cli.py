"""`trackslip <command>`: options in, results out, one line and exit code 2 for a user's mistake."""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import re
import signal
import sys
from collections.abc import Sequence
from typing import Annotated, Any

import tyro

from experiments.bench_config import BenchConfig
from experiments.benchmark_config import BenchmarkConfig
from experiments.calibrate_config import CalibrateConfig
from experiments.config import GridConfig, IdentifyConfig, PredictConfig, ReproduceConfig, TrackConfig
from experiments.coverage_config import CoverageConfig
from experiments.sensitivity_config import SensitivityConfig
from experiments.train_config import TrainConfig
from experiments.validate_config import ValidateConfig
from experiments.view_config import ViewConfig
from trackslip.errors import TrackslipError

Command = (
    Annotated[GridConfig, tyro.conf.subcommand("grid")]
    | Annotated[IdentifyConfig, tyro.conf.subcommand("identify")]
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
    | Annotated[ViewConfig, tyro.conf.subcommand("view")]
)
_DESCRIPTION = """Slip of tracked robots: simulate it, identify it, compensate it. `trackslip COMMAND --help` lists a
command's options."""
_RUNNERS = {
    GridConfig: "experiments.grid",
    IdentifyConfig: "experiments.identify",
    TrackConfig: "experiments.track",
    BenchmarkConfig: "experiments.benchmark",
    TrainConfig: "experiments.train",
    PredictConfig: "experiments.predict",
    CalibrateConfig: "experiments.calibrate",
    ValidateConfig: "experiments.validate",
    CoverageConfig: "experiments.coverage",
    SensitivityConfig: "experiments.sensitivity",
    ReproduceConfig: "experiments.reproduce",
    BenchConfig: "experiments.bench",
    ViewConfig: "experiments.view",
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command; exits with 2 for a mistake in it, 130 when interrupted."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    with contextlib.suppress(ValueError):  # only the main thread may
        signal.signal(signal.SIGTERM, _terminate)
    try:
        command = parse(arguments)
        importlib.import_module(_RUNNERS[type(command)]).run(command)
    except TrackslipError as error:
        _fail(str(error), 2)
    except KeyboardInterrupt as interrupt:
        _fail(str(interrupt) or "interrupted", 130)
    except BrokenPipeError:  # whoever reads has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        _fail(f"can't write ({error.strerror or error})", 2)


def parse(arguments: Sequence[str]) -> Any:
    """The command's configuration; raises TrackslipError in one line for options that are wrong."""
    try:
        with contextlib.redirect_stderr(io.StringIO()):
            return _parse(arguments)
    except SystemExit as stop:
        if stop.code != 2:
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
    raise TrackslipError(_sentence(box.getvalue()))


def _parse(arguments: Sequence[str]) -> Any:
    return tyro.cli(Command, prog="trackslip", args=arguments, description=_DESCRIPTION)


def _sentence(box: str) -> str:
    """The first paragraph of tyro's box under its title, in one line. Where the terminal can't draw, so is the box."""
    box = re.sub(r"\x1b\[[0-9;]*m", "", box)  # colours, on a terminal
    paragraphs: list[list[str]] = [[]]
    for line in box.splitlines():
        text = line.strip().strip("│").strip()
        if line.startswith("╭") or set(text) <= set("-─╰╯"):
            paragraphs.append([])
        else:
            paragraphs[-1].append(text)
    filled = [" ".join(lines) for lines in paragraphs if lines]
    sentence = filled[0 if "╭" in box else 1]
    # name nested fields as the options are: 'Error parsing X.ground: along = -1' -> 'ground.along = -1'
    nested = re.match(r"Error parsing [\w-]+\.([\w.]+): (?=\w+ = )", sentence)
    if nested:
        return f"{nested[1]}.{sentence[nested.end() :]}"
    return re.sub(r"^Error parsing (?:\w+: (?=[\w.]+ = ))?", "", sentence)


def _terminate(*_: object) -> None:
    raise KeyboardInterrupt


def _fail(message: str, code: int) -> None:
    print(f"trackslip: {' '.join(message.split())}", file=sys.stderr)
    sys.exit(code)


if __name__ == "__main__":
    main()
