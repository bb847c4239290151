"""The Markdown pages of the documentation: their code blocks, and what is to be done with each.

A block is a fence with a language, and perhaps a comment on the line above it that says what is special about it:

    <!-- parsed only: why -->   commands that take long; their options are checked
    <!-- not run: why -->       commands that aren't trackslip's
    <!-- refused -->            commands that must end with exit code 2
    <!-- file: NAME -->         a file that later blocks use

Blocks `text` are output: of the block that was run last, if it was.
"""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
LANGUAGES = ("python", "sh", "toml", "csv", "text")
DIRECTIVES = ("parsed only", "not run", "refused", "file")

_FENCE = re.compile(r"^(```+|~~~+)\s*(\S*)\s*$")
_COMMENT = re.compile(r"^<!-- ([a-z ]+?)(?:: (.+))? -->$")
_EVAL = re.compile(r'eval "\$\((.*)\)"')
_MPI = re.compile(r"mpiexec -n \d+ python -m mpi4py\.futures -m experiments\.cli (.*)")


@dataclass(frozen=True)
class Block:
    """A code block."""

    line: int
    """Of its first line, counted from 1."""
    language: str
    directive: str
    """One of DIRECTIVES, or empty."""
    about: str
    """What the directive says: a file's name, or a reason."""
    text: str


def blocks(page: str) -> list[Block]:
    """The fenced blocks of a page; raises ValueError for what the documentation can't have."""
    found: list[Block] = []
    lines = page.splitlines()
    begin: int | None = None
    fence = language = ""
    for number, line in enumerate(lines):
        match = _FENCE.match(line)
        if begin is None and match:
            begin, fence, language = number, match[1], match[2]
        elif begin is not None and line.strip() == fence:
            found.append(_block(lines, begin, number, language))
            begin = None
        elif begin is None and line.lstrip().startswith(("```", "~~~")):
            raise ValueError(f"line {number + 1}: a fence that isn't at the line's begin, or says more than a language")
    if begin is not None:
        raise ValueError(f"line {begin + 1}: a fence without an end")
    return found


def _block(lines: list[str], begin: int, end: int, language: str) -> Block:
    if language not in LANGUAGES:
        raise ValueError(f"line {begin + 1}: language {language!r}, must be one of {', '.join(LANGUAGES)}")
    match = _COMMENT.match(lines[begin - 1]) if begin else None
    directive, about = (match[1], match[2] or "") if match else ("", "")
    if directive and directive not in DIRECTIVES:
        raise ValueError(f"line {begin}: {directive!r}, must be one of {', '.join(DIRECTIVES)}")
    if directive in ("parsed only", "not run", "file") and not about:
        raise ValueError(f"line {begin}: {directive!r} of what, or why?")
    if language in ("toml", "csv") and directive != "file":
        raise ValueError(f"line {begin + 1}: a file without a name")
    return Block(begin + 1, language, directive, about, "\n".join(lines[begin + 1 : end]) + "\n")


def commands(text: str) -> list[str]:
    """The commands of a block `sh`, a line each."""
    joined = re.sub(r"\\\n\s*", "", text)
    return [line.strip() for line in joined.splitlines() if line.strip() and not line.lstrip().startswith("#")]


def arguments(command: str) -> list[str]:
    """What comes after `trackslip` in a command; raises ValueError for any other program."""
    for pattern in (_EVAL, _MPI):
        match = pattern.fullmatch(command)
        if match:
            command = match[1] if pattern is _EVAL else f"trackslip {match[1]}"
    name, *rest = shlex.split(command, comments=True)
    if name != "trackslip":
        raise ValueError(f"{command!r}: not a command of trackslip's")
    return rest


def indented(page: str) -> list[str]:
    """Commands that stand in a page by themselves, indented by four spaces."""
    return [line.strip() for line in page.splitlines() if line.startswith("    trackslip ")]


def links(page: str) -> list[str]:
    """Files that a page links to or shows."""
    found = re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page)
    return [link for link in found if "://" not in link]
