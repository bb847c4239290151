"""The `trackslip` command line: find a command, parse its options, run it; errors print a line and
exit with 2.
"""

import ast
import contextlib
import functools
import importlib
import importlib.metadata
import io
import itertools
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NoReturn

import tyro

from experiments.common.streams import PrintableOutput, flush_or_discard, printable
from experiments.common.temporary import temporary_files
from trackslip.errors import InvalidValueError, TrackslipError, one_of

EXAMPLES: Final = (
    ("the whole paper, with a report in out/reproduce/report.html", "trackslip reproduce"),
    ("a command's usual options, or all of them", "trackslip grid --help"),
    (
        "complete commands and options with Tab in bash (or zsh, fish)",
        'eval "$(trackslip --tyro-print-completion bash)"',
    ),
)
"""Descriptions and command lines at the end of `trackslip --help`; each command has EXAMPLES,
too.
"""

_HELP: Final = """usage: trackslip COMMAND [OPTIONS]

Slip of tracked robots: simulate it, identify it, compensate for it.
`trackslip COMMAND --help` lists the options of a command that most people
need, with examples, `--help-all` lists all of them,
`trackslip --version` prints the version.
"""
_GROUPS: Final = {
    "simulate": ("reproduce", "grid", "wander", "drive"),
    "identify": ("identify", "evaluate", "predict", "plan", "deploy"),
    "control": ("track", "benchmark", "tune", "train"),
    "robots": ("calibrate", "validate"),
    "logs": ("log", "view"),
}
"""Headings in the help, with their commands; commands without a heading come last."""
_INSTEAD: Final = {
    "bag": "trackslip log BAG",
    "export": "trackslip log PATH --out FILE",
    "localize": "trackslip log BAG --plate 0.5x0.02",
    "replay": "trackslip evaluate LOG --robot ROBOT --ground GROUND",
    "reality": "trackslip evaluate DATA_SET.toml",
    "coverage": "pytest -m slow tests/validation",
    "sensitivity": "trackslip grid --sweep examples/sensitivity.toml",
    "bench": "pytest tests/benchmarks",
}
"""Replacements for the removed commands of version 0.2."""
_SHORT: Final = 3  # number of examples where `--help` doesn't show all options
_ROOT: Final = Path(__file__).parent
_KERNEL: Final = ("__init__", "__main__", "cli")  # files here that are not commands


@functools.cache
def commands() -> dict[str, str]:
    """All commands by name, each with a sentence; a command is a file here or a folder with a
    command.py.
    """
    sources = {file.stem: file for file in _ROOT.glob("*.py") if file.stem not in _KERNEL}
    sources |= {
        file.parent.name: file.with_name("__init__.py") for file in _ROOT.glob("*/command.py")
    }
    return {name: _sentence(sources[name]) for name in sorted(sources)}


def _sentence(file: Path) -> str:
    """First paragraph of the docstring of a command's module, without the command's name."""
    text = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    return " ".join(text.partition("\n\n")[0].partition(": ")[2].split())


def config_module(command: str) -> Any:
    """The module with a command's `Config`, its `EXAMPLES` and, if it has many options, the names
    of the `ESSENTIAL` ones, which `--help` shows.
    """
    folder = (_ROOT / command / "config.py").exists()
    return importlib.import_module(
        f"experiments.{command}.config" if folder else f"experiments.{command}"
    )


def run_module(command: str) -> Any:
    """The module with a command's `run(config)`."""
    folder = (_ROOT / command / "command.py").exists()
    return importlib.import_module(
        f"experiments.{command}.command" if folder else f"experiments.{command}"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command; exits with 2 after an error, and with 130 when interrupted."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    try:
        try:
            shown: list[str] = []
            with warnings.catch_warnings():
                warnings.showwarning = functools.partial(_warn, shown)
                _require_utf8(arguments)
                _run(arguments, shown)
        finally:
            sys.stdout.flush()  # here, because Python would end with a traceback if it can't
    except TrackslipError as error:
        _fail(str(error), 2)
    except UnicodeEncodeError as error:  # from the name of a folder or file that is read
        _fail(f"{error.object[:200]!r}: can't be written as {error.encoding}", 2)
    except KeyboardInterrupt as interrupt:
        _fail(str(interrupt) or "interrupted", 130)
    except OSError as error:
        flush_or_discard(sys.stdout)
        if isinstance(error, BrokenPipeError):  # the reader closed the pipe
            sys.exit(1)
        _fail(f"{error.filename or 'output'}: can't be written ({error.strerror or error})", 2)


def _require_utf8(arguments: Sequence[str]) -> None:
    """Raise InvalidValueError for an argument that isn't UTF-8, as all results and messages are."""
    for option, argument in itertools.pairwise(("COMMAND", *arguments)):
        name, equals, _ = argument.partition("=")
        named = name if equals and name.startswith("--") else option
        try:
            argument.encode()
        except UnicodeEncodeError:
            field = named.lstrip("-") if named.startswith("--") else "argument"
            raise InvalidValueError(field, argument, "text in UTF-8") from None


def _run(arguments: Sequence[str], warned: list[str]) -> None:
    """Run a command; `warned` are the warnings that were printed until now."""
    match arguments:
        case ["--version"]:
            print(f"trackslip {importlib.metadata.version('trackslip')}")
        case [] | ["-h" | "--help", *_]:
            print(_HELP)
            listed = [name for names in _GROUPS.values() for name in names]
            for group, names in {
                **_GROUPS,
                "others": [name for name in commands() if name not in listed],
            }.items():
                if names:
                    print(
                        f"{group}:",
                        *(f"  {name:10} {commands()[name]}" for name in names),
                        "",
                        sep="\n",
                    )
            print(_examples(EXAMPLES))
        case [flag, *_] if flag.startswith("--tyro-"):
            configs = {name: config_module(name).Config for name in commands()}
            tyro.extras.subcommand_cli_from_dict(configs, prog="trackslip", args=arguments)
        case [name, *_]:
            config = parse(arguments)
            with contextlib.redirect_stdout(PrintableOutput(sys.stdout)):
                if getattr(config, "stores_results", False):
                    _run_or_print_stored(name, config, warned)
                else:
                    with temporary_files():
                        run_module(name).run(config)
                sys.stdout.flush()


def _run_or_print_stored(name: str, config: Any, warned: list[str]) -> None:
    """Run a command and store what it prints, or print what it has stored."""
    from experiments.common.stored import stored_result, storing  # late, for `--help`

    stored = None if config.runs_anew else stored_result(name, config)
    if stored is None:
        with temporary_files() as temporary, storing(config, warned, temporary):
            run_module(name).run(config)
    else:
        stored.print()
        if stored.exit_code:
            sys.exit(stored.exit_code)


def parse(arguments: Sequence[str]) -> Any:
    """Parse a command line into an instance of the command's Config.

    Raises:
        TrackslipError: for an unknown command, and for a value that the options refuse.
        SystemExit: after printing help, or tyro's explanation of the arguments that it rejects.
    """
    name, *options = arguments
    if name not in commands():
        if name in _INSTEAD:
            raise TrackslipError(f"{name} is gone; use: {_INSTEAD[name]}")
        raise InvalidValueError("COMMAND", name, one_of(commands(), name))
    module = config_module(name)
    shown = module.Config
    examples = module.EXAMPLES
    further = ""
    if "--help-all" in options:
        options = ["--help"]
    elif {"-h", "--help"} & set(options) and hasattr(module, "ESSENTIAL"):
        from experiments.common.short_help import essential  # late, as only help needs it

        options = ["--help"]
        shown = essential(module.Config, module.ESSENTIAL)
        examples = module.EXAMPLES[:_SHORT]
        further = f"all options and examples: trackslip {name} --help-all"
    explanation = io.StringIO()
    try:
        with contextlib.redirect_stderr(explanation):
            return tyro.cli(
                shown,
                prog=f"trackslip {name}",
                args=options,
                config=(tyro.conf.DisallowNone, tyro.conf.HelptextFromCommentsOff),
            )
    except SystemExit as stop:
        if stop.code and (refused := _refused_value(stop)):
            raise refused from None
        sys.stderr.write(explanation.getvalue())
        if not stop.code:
            print(_examples(examples), further, sep="\n", end="\n" if further else "")
        raise


def _examples(examples: Sequence[tuple[str, str]]) -> str:
    return "\n".join(["examples:", *(f"  {line}\n      {what}" for what, line in examples)])


def _refused_value(stop: SystemExit) -> InvalidValueError | None:
    """The error for a refused value, if it made tyro stop, with the option's full name, such as
    ground.across.
    """
    group = ""
    error = stop.__context__
    while error is not None and not isinstance(error, InvalidValueError):
        group, error = getattr(error, "arg", ""), error.__context__  # name of a group of options
    if error is None or not group:
        return error
    return InvalidValueError(
        f"{group}.{error.field}".removesuffix(".force"), error.value, error.allowed
    )


def _warn(shown: list[str], message: Warning | str, *_: object, **__: object) -> None:
    """Print a warning once, in one line, without the code that issued it; see
    `warnings.showwarning`.
    """
    line = printable(" ".join(str(message).split()))
    if line not in shown:
        shown.append(line)
        print(f"warning: {line}", file=sys.stderr)


def _fail(message: str, code: int) -> NoReturn:
    line = printable(" ".join(message.split()))
    for stream in (sys.stderr, sys.stdout):
        try:
            print(f"trackslip: {line}", file=stream, flush=True)
            break
        except OSError:  # a full disk; the line goes to the other stream
            flush_or_discard(stream)
    sys.exit(code)
