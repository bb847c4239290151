"""Text for the terminal: names from files can't control it."""

import io
from typing import TextIO


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
