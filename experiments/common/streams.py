"""Standard output and standard error: they may be closed, full, or unable to write a character, and
names from files must not control them.
"""

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


def printable(text: str) -> str:
    """`text` with ? for each control character, except line breaks and tabs.

    Names of runs and topics come from files, which may be from strangers: escape sequences in them
    could rewrite what is on the screen, or the window's title.
    """
    return "".join(c if c.isprintable() or c in "\n\t" else "?" for c in text)


class PrintableOutput(io.TextIOBase):
    """A stream that passes printable text on to another stream."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """Encoding of the stream."""
        return self._stream.encoding

    def write(self, text: str) -> int:
        """Write text without control characters."""
        self._stream.write(printable(text))
        return len(text)

    def flush(self) -> None:
        """Flush the stream."""
        self._stream.flush()

    def fileno(self) -> int:
        """Descriptor of the stream."""
        return self._stream.fileno()
