"""The `trackslip` command line: options in, results out; a refused value prints a one-line error and exits with 2."""

import contextlib
import functools
import importlib
import importlib.metadata
import io
import itertools
import os
import pkgutil
import re
import sys
import typing
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import tyro

from experiments import commands
from trackslip.errors import InvalidValueError, TrackslipError

EXAMPLES = (
    ("the whole paper, with a report in out/reproduce/report.html", "trackslip reproduce"),
    ("a command's options and examples", "trackslip grid --help"),
    (
        "complete commands and options with Tab in bash (or zsh, fish)",
        'eval "$(trackslip --tyro-print-completion bash)"',
    ),
)
"""Descriptions and command lines at the end of `trackslip --help`; each command has EXAMPLES, too."""

_DESCRIPTION = """Slip of tracked robots: simulate it, identify it, compensate for it.
`trackslip COMMAND --help` lists a command's options and examples, `trackslip --version` prints the version."""
_COMPLETION = ("--tyro-print-completion", "--tyro-write-completion")
_KINDS = {
    "INT": "a whole number",
    "FLOAT": "a number",
    "MB": "a number of MB",
    "FLOAT FLOAT": "two numbers",
    "[INT [INT ...]]": "whole numbers",
    "[FLOAT [FLOAT ...]]": "numbers",
}
_LONGEST = 4096  # argument, as paths are limited to
_SHELLS = ("bash", "zsh", "fish", "tcsh")


@functools.cache
def command_modules() -> dict[str, Any]:
    """The modules in experiments.commands by name: each has a `Config`, `EXAMPLES` and `run(config)`."""
    names = [module.name for module in pkgutil.iter_modules(commands.__path__)]
    return {name: importlib.import_module(f"{commands.__name__}.{name}") for name in names}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command; exits with 2 for a mistake in it, 130 when interrupted."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    try:
        if arguments == ["--version"]:
            print(f"trackslip {importlib.metadata.version('trackslip')}", flush=True)
            return
        config = parse(arguments)
        with warnings.catch_warnings():
            warnings.showwarning = functools.partial(_warn, set())
            command_modules()[arguments[0]].run(config)
        sys.stdout.flush()
    except TrackslipError as error:
        _fail(str(error), 2)
    except KeyboardInterrupt as interrupt:
        _fail(str(interrupt) or "interrupted", 130)
    except RuntimeError as error:
        if "MUJOCO_GL" not in str(error):  # MuJoCo's own, when it is imported
            raise
        _fail(f"{error}: must be egl, osmesa, glfw or disabled", 2)
    except (MemoryError, ImportError) as error:
        if isinstance(error, ImportError) and "failed to map segment" not in str(error):  # of a library
            raise
        _fail("out of memory", 2)
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):  # the reader has seen enough
            sys.exit(1)
        _fail(f"can't write ({error.strerror or error})", 2)


def parse(arguments: Sequence[str]) -> Any:
    """The command's options, an instance of its Config.

    Raises:
        TrackslipError: for a value that the options refuse.
        SystemExit: after help, and for arguments that tyro rejects, once it has explained them.
    """
    _check(arguments)
    explanation = io.StringIO()
    try:
        with contextlib.redirect_stderr(explanation):
            return tyro.extras.subcommand_cli_from_dict(
                {
                    name: _listed(module.Config) if arguments[:1] in (["-h"], ["--help"]) else module.Config
                    for name, module in command_modules().items()
                },
                prog="trackslip",
                args=arguments,
                description=_DESCRIPTION,
                config=(tyro.conf.DisallowNone, tyro.conf.HelptextFromCommentsOff),
            )
    except SystemExit as stop:
        if stop.code and (refused := _refused_value(stop) or _mistyped(explanation.getvalue(), arguments)):
            raise refused from None
        sys.stderr.write(explanation.getvalue())
        if not stop.code and arguments[0] not in _COMPLETION:
            print(examples_text("" if arguments[0].startswith("-") else arguments[0]))
        sys.stdout.flush()
        raise


def _listed(config: type) -> Callable[[], None]:
    """A command without options, described by the first sentence of its help, for the list of commands."""

    def command() -> None: ...

    command.__doc__ = (config.__doc__ or "").partition("\n\n")[0]
    return command


def examples_text(command: str) -> str:
    """The end of a command's help, or of trackslip's own for an empty name."""
    examples = command_modules()[command].EXAMPLES if command else EXAMPLES
    return "\n".join(["examples:", *(f"  {line}\n      {what}" for what, line in examples)])


def _refused_value(stop: SystemExit) -> InvalidValueError | None:
    """The options' own error if it is why tyro stops; its field is named as the option is, ground.across."""
    cause = stop.__context__
    if cause is None or not isinstance(cause.__context__, InvalidValueError):
        return None
    refused = cause.__context__
    group = str(getattr(cause, "arg", "")).partition(".")[2]
    return InvalidValueError(f"{group}.{refused.field}", refused.value, refused.allowed) if group else refused


def _mistyped(explanation: str, arguments: Sequence[str]) -> InvalidValueError | None:
    """The error for a value of another type than the option's, which tyro explains in Python's words; else None."""
    parsed = re.search(r"Error parsing (--[\w.-]+):", explanation)
    if parsed is None:
        return None
    option = parsed[1]
    lines = (line.strip("│| ") for line in explanation.splitlines())  # in a box, of ASCII where a terminal needs it
    kind = next((line for line in lines if line.startswith(f"{option} ")), "").partition(" ")[2]
    given = next((k for k, argument in enumerate(arguments) if argument.partition("=")[0] == option), None)
    if not kind or given is None:
        return None
    values = [arguments[given].partition("=")[2]] if "=" in arguments[given] else []
    values += itertools.takewhile(lambda argument: not argument.startswith("--"), arguments[given + 1 :])
    return InvalidValueError(option.removeprefix("--"), " ".join(values), _KINDS.get(kind, kind))


def _check(arguments: Sequence[str]) -> None:
    """Raise TrackslipError for arguments that tyro would accept silently, or reject with a traceback."""
    if arguments[:1] and not arguments[0].startswith("-") and arguments[0] not in command_modules():
        raise InvalidValueError("COMMAND", arguments[0], f"one of {', '.join(command_modules())}")
    if arguments[:1] and arguments[0] in _COMPLETION and arguments[1:2] and arguments[1] not in _SHELLS:
        raise InvalidValueError(arguments[0], arguments[1], f"one of {', '.join(_SHELLS)}")
    given: set[str] = set()
    option = "trackslip"
    for argument in arguments:
        if not argument or (argument.startswith("--") and argument.endswith("=")):
            raise InvalidValueError(argument.removesuffix("=") or option, "", "non-empty")
        if len(argument) > _LONGEST:
            raise InvalidValueError(option, f"{argument[:20]}...", f"at most {_LONGEST} characters long")
        if any("\ud800" <= character <= "\udfff" for character in argument):
            raise InvalidValueError(option, argument, "valid UTF-8")
        if argument.startswith("--"):
            option = argument.partition("=")[0].replace("_", "-")
            switch = option.replace("--no-", "--", 1)
            if switch in given and not _repeatable(arguments[0], option):
                raise TrackslipError(f"{option} is given twice; give it once, with all its values")
            given.add(switch)


def _repeatable(command: str, option: str) -> bool:
    """True if an option of a command may be given more than once."""
    module = command_modules().get(command)  # None where an option comes first
    hints = typing.get_type_hints(module.Config, include_extras=True) if module else {}
    hint = hints.get(option.removeprefix("--").replace("-", "_"))
    return tyro.conf.UseAppendAction in getattr(hint, "__metadata__", ())


def _warn(shown: set[str], message: Warning | str, *_: object, **__: object) -> None:
    """Show a warning in one line, once, without the line of code that gives it; see `warnings.showwarning`."""
    line = " ".join(str(message).split())
    if line not in shown:
        shown.add(line)
        print(f"warning: {line}", file=sys.stderr)


def _fail(message: str, code: int) -> None:
    line = "".join(c if c.isprintable() else "?" for c in " ".join(message.split()))
    print(f"trackslip: {line}", file=sys.stderr)
    sys.exit(code)


if __name__ == "__main__":
    _fail("start it as `trackslip` or `python -m experiments`", 2)
