"""Markdown pages of the documentation and their code blocks.

A block is a fence with a language. A comment on the line above it may say what is special about it:

    <!-- slow: how long -->     commands that the default tests only parse; the slow tests run them
    <!-- needs: MODULE -->      commands that are only parsed where this optional library is missing
    <!-- parsed only: why -->   commands that no test runs: they need a cluster, hours, or measure a machine
    <!-- not run: why -->       commands that aren't trackslip's
    <!-- refused -->            commands that must end with exit code 2
    <!-- file: NAME -->         a file that later blocks use

`text` blocks are the output of the block before them, to the digit. A line that ends in … leaves out the rest of it.
"""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
LANGUAGES = ("python", "sh", "c", "xml", "toml", "csv", "text", "bibtex")
DIRECTIVES = ("slow", "needs", "parsed only", "not run", "refused", "file")

_FENCE = re.compile(r"^(```+|~~~+)\s*(\S*)\s*$")
_COMMENT = re.compile(r"^<!-- ([a-z ]+?)(?:: (.+))? -->$")


@dataclass(frozen=True)
class Block:
    """A code block."""

    line: int
    """Line number of the fence, counted from 1."""
    language: str
    directive: str
    """One of DIRECTIVES, or empty."""
    about: str
    """What the directive says: a file's name, a module, or a reason."""
    text: str


def blocks(page: str) -> list[Block]:
    """The fenced blocks of a page.

    Raises:
        ValueError: for a fence without an end, an unknown language or directive, or a file without a name.
    """
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
            raise ValueError(f"line {number + 1}: a fence must start its line and name only a language")
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
    if directive not in ("", "refused") and not about:
        raise ValueError(f"line {begin}: {directive!r} needs a reason or a name")
    if language in ("toml", "csv") and directive != "file":
        raise ValueError(f"line {begin + 1}: a file without a name")
    return Block(begin + 1, language, directive, about, "\n".join(lines[begin + 1 : end]) + "\n")


def shown(page: Path, text: str) -> str:
    """The one `text` block of a page that contains a text; raises ValueError unless there is exactly one."""
    (found,) = [b.text for b in blocks(page.read_text(encoding="utf-8")) if b.language == "text" and text in b.text]
    return found


def commands(text: str) -> list[str]:
    """The commands of an `sh` block, one a line."""
    joined = re.sub(r"\\\n\s*", "", text)
    return [line.strip() for line in joined.splitlines() if line.strip() and not line.lstrip().startswith("#")]


def arguments(command: str) -> list[str]:
    """The arguments of a `trackslip` command; raises ValueError for any other program."""
    name, *rest = shlex.split(command, comments=True)
    if name != "trackslip":
        raise ValueError(f"{command!r}: not a trackslip command")
    return rest


def links(page: str) -> list[str]:
    """Files that a page links to or shows."""
    found = re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page)
    return [link for link in found if "://" not in link]


def missing_line(text: str, printed: str) -> str | None:
    """The first shown line that wasn't printed in this order, or None: words and numbers as printed, spacing apart."""
    there = iter([line.split() for line in printed.splitlines() if line.strip()])
    for line in filter(None, map(str.strip, text.splitlines())):
        words = line.removesuffix("…").split()
        if not any(words == (found[: len(words)] if line.endswith("…") else found) for found in there):
            return line
    return None
