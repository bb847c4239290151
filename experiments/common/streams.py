"""Standard output and standard error, which may be closed, full, or unable to write a character."""

import codecs
import io
import os
import sys
from typing import Final, TextIO

REPLACEMENTS: Final = {
    "−": "-",
    "–": "-",
    "→": "->",
    "×": "x",
    "·": "*",
    "…": "...",
    "“": '"',
    "”": '"',
    "’": "'",
    "²": "^2",
    "°": " deg",
    "±": "+/-",
}
"""What stands for characters that a terminal can't write; for all others, a question mark."""
ERRORS: Final = "trackslip.replace"
"""Name under which Python knows the replacement of characters."""


def prepare() -> None:
    """Let both streams replace characters that they can't write; exits with 2 if one of them is
    closed, before a file of the command takes its place.
    """
    codecs.register_error(ERRORS, _replace)
    for name, stream, other in (
        ("output", sys.stdout, sys.stderr),
        ("error", sys.stderr, sys.stdout),
    ):
        if stream is None:
            line = f"trackslip: standard {name} is closed; to discard it, send it to {os.devnull}"
            print(line, file=other)
            sys.exit(2)
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=ERRORS)


def _replace(error: UnicodeError) -> tuple[str, int]:
    """Replacement of the characters that can't be encoded; see `codecs.register_error`."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    unknown = error.object[error.start : error.end]
    return "".join(REPLACEMENTS.get(character, "?") for character in unknown), error.end


def flush_or_discard(stream: TextIO) -> None:
    """Write what a stream has buffered; if it can't, discard that and what follows, at which Python
    would fail at its exit.
    """
    try:
        stream.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
