"""The format of `--help` where tyro's default falls short: defaults in words, and long lines."""

import io
import re
import sys
import textwrap

import tyro

_COLOURS = re.compile(r"\x1b\[[0-9;]*m")


def default_is(text: str, metavar: str) -> object:
    """Annotation of an option that is None by default: what `--help` prints as its default, and for its value."""
    return tyro.conf.arg(metavar=metavar, help_behavior_hint=f"(default: {text})")


class HelpBuffer(io.StringIO):
    """Collects what tyro prints, as coloured and boxed as on standard output."""

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """That of standard output."""
        return "utf-8" if sys.__stdout__ is None else sys.__stdout__.encoding

    def isatty(self) -> bool:
        """Whether standard output is a terminal."""
        return sys.__stdout__ is not None and sys.__stdout__.isatty()


def wrapped(text: str, width: int) -> str:
    """Help with the usage and the description wrapped, which tyro leaves as long as they are."""
    lines = []
    for line in text.rstrip().splitlines():
        plain = _COLOURS.sub("", line)
        if plain[:1] in ("╭", "│", "╰", " ") or len(plain) <= width:
            lines.append(line)
        elif plain.startswith("usage:"):
            lines += [part.replace(", ", ",") for part in textwrap.wrap(plain.replace(",", ", "), width)]
        else:
            lines += textwrap.wrap(plain, width)
    return "\n".join(lines)
