"""Markdown pages of the documentation: their code blocks, run and compared with what the page
shows.

A block is a fence with a language. A comment on the line above it may say what is special about it:

    <!-- slow: how long -->     commands that the default tests only parse; the slow tests run them
    <!-- needs: MODULE -->      commands that are only parsed where this optional library is missing
    <!-- parsed only: why -->   commands that no test runs: they need a cluster, hours, or measure a
    machine <!-- not run: why -->       commands that aren't trackslip's <!-- refused -->
    commands that must end with exit code 2 <!-- file: NAME -->         a file that later blocks use

`text` blocks are the output of the block before them, to the digit. A line … stands for lines that
are left out, and a line that ends in … leaves out the rest of it.
"""

import importlib.util
import re
import shlex
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from experiments.cli import main, parse

ROOT = Path(__file__).parents[2]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
LANGUAGES = ("python", "sh", "c", "xml", "toml", "csv", "text", "bibtex")
LEFT_OUT = "…"
DIRECTIVES = ("", "slow", "needs", "parsed only", "not run", "refused", "file")
_BLOCK = re.compile(
    r"(?:^<!-- ([a-z ]+)(?:: (.+))? -->\n)?^(```+|~~~+)(.*)\n((?:.*\n)*?)\3$", re.MULTILINE
)


@dataclass(frozen=True)
class Block:
    line: int  # of its beginning, counted from 1
    language: str
    directive: str  # one of DIRECTIVES
    about: str  # what the directive says: a file's name, a module, or a reason
    text: str


def blocks(page: str) -> list[Block]:
    """The fenced blocks of a page; raises ValueError for an unknown language or directive."""
    parts = []
    for match in _BLOCK.finditer(page):
        directive, about, _, language, text = match.groups(default="")
        line = page.count("\n", 0, match.start()) + 1
        if language not in LANGUAGES or directive not in DIRECTIVES:
            raise ValueError(
                f"line {line}: unknown language {language!r} or directive {directive!r}"
            )
        parts.append(Block(line, language, directive, about, text))
    return parts


def shown(page: Path, text: str) -> str:
    """The one `text` block of a page that contains a text."""
    (block,) = [
        b.text
        for b in blocks(page.read_text(encoding="utf-8"))
        if b.language == "text" and text in b.text
    ]
    return block


def commands(text: str) -> list[list[str]]:
    """Arguments of each `trackslip` command in an `sh` block."""
    lines = [shlex.split(line, comments=True) for line in text.replace("\\\n", " ").splitlines()]
    assert all(line[0] == "trackslip" for line in lines if line), text
    return [line[1:] for line in lines if line]


def links(page: str) -> list[str]:
    return [link for link in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page) if "://" not in link]


def difference(text: str, printed: str) -> str | None:
    """What a shown text has that wasn't printed in this order, or that it leaves lines out and has
    no line … for them; None if nothing: words and numbers as printed, spacing and the rules of
    tables apart.
    """
    rows = [line.split() for line in printed.splitlines() if line.strip(" ─")]
    shown = [line.strip() for line in text.splitlines() if line.strip(" ─")]
    lines = [line for line in shown if line != LEFT_OUT]
    place = 0
    for line in lines:
        words = line.removesuffix(LEFT_OUT).split()
        length = len(words) if line.endswith(LEFT_OUT) else None
        found = next((k for k in range(place, len(rows)) if words == rows[k][:length]), None)
        if found is None:
            return f"not printed: {line}"
        place = found + 1
    if len(lines) < len(rows) and LEFT_OUT not in shown:
        return f"left out without a line {LEFT_OUT}: {len(rows) - len(lines)} lines"
    return None


@dataclass
class PageRunner:
    """Runs the blocks of a page, in order, and compares what they print with what it shows."""

    folder: Path  # where the page's files are written: the working directory
    captured: Callable[[], str]  # gives what was printed since the last call
    slow: bool = False  # whether slow blocks are run, too; their commands are parsed anyhow
    names: dict[str, Any] = field(default_factory=lambda: {"__name__": "__main__"})
    printed: str | None = None  # by the block before, if it was run

    def __post_init__(self) -> None:
        if not (self.folder / "examples").exists():  # pages are read in a checkout
            (self.folder / "examples").symlink_to(ROOT / "examples")

    def run(self, block: Block) -> None:
        """Run a block; raises AssertionError where a page shows what wasn't printed, or a command
        ends otherwise.
        """
        if block.language == "text":
            is_checked = self.printed is not None and not block.directive
            wrong = difference(block.text, self.printed) if is_checked else None
            assert wrong is None, f"{wrong}\nprinted was:\n{self.printed}"
            return
        runs = self._runs(block)
        if block.directive == "file":
            (self.folder / block.about).write_text(block.text, encoding="utf-8")
        if block.language == "python" and runs:
            exec(compile(block.text, f"line {block.line}", "exec"), self.names)
        elif block.language == "sh" and block.directive != "not run":
            for words in commands(block.text):
                self._command(words, block.directive) if runs else parse(words)
        self.printed = self.captured() if runs else None

    def _runs(self, block: Block) -> bool:
        if block.directive == "needs":
            return importlib.util.find_spec(block.about) is not None
        return block.directive not in ("parsed only", "not run") and (
            self.slow or block.directive != "slow"
        )

    def _command(self, given: list[str], directive: str) -> None:
        code = 0
        try:
            main(given)
        except SystemExit as stop:
            code = stop.code or 0
        assert code == (2 if directive == "refused" else 0), given
