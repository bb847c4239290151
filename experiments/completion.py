"""`trackslip completion`: a script for the shell, made from the commands' options."""

from __future__ import annotations

import dataclasses
import shlex
import types
import typing
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Literal

import tyro

from experiments.completion_config import CompletionConfig
from experiments.options.benchmark import CONTROLLER_NAMES, REFERENCE_NAMES
from sim.ground.named import NAMED_GROUNDS
from sim.scanner.named_obstacles import NAMED_OBSTACLES

Options = Mapping[str, tuple[str, ...]]
"""The values that can be listed, of each option of a command."""

_NAMES = {
    **dict.fromkeys(("--controller", "--controllers"), CONTROLLER_NAMES),
    **dict.fromkeys(("--reference", "--references"), REFERENCE_NAMES),
    **dict.fromkeys(("--ground", "--grounds"), tuple(NAMED_GROUNDS)),
    "--obstacles": tuple(NAMED_OBSTACLES),
}
"""Of options that take other text too."""

_ONE_WAY = typing.get_args(tyro.conf.FlagCreatePairsOff[bool])[-1]
_POSITIONAL = typing.get_args(tyro.conf.Positional[int])[1]


def run(config: CompletionConfig) -> None:
    """Print the script."""
    print(SCRIPTS[config.shell](commands()), end="")


def commands() -> dict[str, Options]:
    """The options of every command."""
    from experiments.cli import Command  # late: it names this module's command too

    found: dict[str, Options] = {}
    for part in typing.get_args(Command):
        config, subcommand = typing.get_args(part)
        found[subcommand.name] = {"--help": (), **dict(options(config))}
    return found


def options(config: type, prefix: str = "") -> Iterator[tuple[str, tuple[str, ...]]]:
    """Options of a configuration, a name and the values that can be listed."""
    hints = typing.get_type_hints(config, include_extras=True)
    for field in dataclasses.fields(config):
        hint = hints[field.name]
        marks: tuple[Any, ...] = getattr(hint, "__metadata__", ())
        hint = typing.get_args(hint)[0] if marks else hint
        if _POSITIONAL in marks:
            continue
        names = [mark.name for mark in marks if getattr(mark, "name", None) is not None]
        name = prefix + (names[0] if names else field.name.replace("_", "-"))
        if dataclasses.is_dataclass(hint):
            yield from options(typing.cast(type, hint), f"{name}.")
            continue
        option = f"--{name.removesuffix('.')}"
        yield option, tuple(_literals(hint)) or _NAMES.get(option, ())
        if hint is bool and _ONE_WAY not in marks:
            yield f"--no-{name}", ()


def _literals(hint: Any) -> Iterator[str]:
    """The strings that a type allows, alone or in a tuple."""
    if typing.get_origin(hint) is Literal:
        yield from typing.get_args(hint)
    elif typing.get_origin(hint) in (tuple, types.UnionType, typing.Union):
        for part in typing.get_args(hint):
            yield from _literals(part)


_BASH = """\
_trackslip() {{
  local current="${{COMP_WORDS[COMP_CWORD]}}" option="" words="" k
  for ((k = COMP_CWORD - 1; k > 1; k--)); do
    case "${{COMP_WORDS[k]}}" in --*) option="${{COMP_WORDS[k]}}"; break ;; esac
  done
  if [ "$COMP_CWORD" -eq 1 ]; then
    words="--help {commands}"
  elif [ "${{current#-}}" != "$current" ]; then
    case "${{COMP_WORDS[1]}}" in
{options}
    esac
  else
    case "${{COMP_WORDS[1]}} $option" in
{values}
    esac
  fi
  COMPREPLY=($(compgen -W "$words" -- "$current"))
}}
complete -o default -F _trackslip trackslip  # files, where nothing else fits
"""

_ZSH = """\
whence compdef >/dev/null || { autoload -Uz compinit && compinit; }
autoload -Uz bashcompinit && bashcompinit
"""


def bash(found: Mapping[str, Options]) -> str:
    """For bash."""
    listed = [f'      {name}) words="{" ".join(known)}" ;;' for name, known in found.items()]
    values = [
        f'      "{name} {option}") words="{" ".join(values)}" ;;'
        for name, known in (*found.items(), ("completion", {"": tuple(SCRIPTS)}))
        for option, values in known.items()
        if values
    ]
    return _BASH.format(commands=" ".join(found), options="\n".join(listed), values="\n".join(values))


def zsh(found: Mapping[str, Options]) -> str:
    """For zsh, which understands bash's."""
    return _ZSH + bash(found)


def fish(found: Mapping[str, Options]) -> str:
    """For fish."""
    lines = [f"complete -c trackslip -n __fish_use_subcommand -f -a {shlex.quote(' '.join(found))}"]
    for name, known in found.items():
        here = f"complete -c trackslip -n '__fish_seen_subcommand_from {name}'"
        for option, values in known.items():
            listed = f" -r -a {shlex.quote(' '.join(values))}" if values else ""
            lines.append(f"{here} -l {option.removeprefix('--')}{listed}")
    lines.append(f"complete -c trackslip -n '__fish_seen_subcommand_from completion' -f -a '{' '.join(SCRIPTS)}'")
    return "\n".join(lines) + "\n"


SCRIPTS: dict[str, Callable[[Mapping[str, Options]], str]] = {"bash": bash, "zsh": zsh, "fish": fish}
"""Makers of scripts, by shell."""
