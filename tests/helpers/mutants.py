"""Mutants of files: bytes changed, cut off or repeated, numbers of binary formats and tokens of
texts replaced by hostile ones, lines left out, repeated or moved.
"""

import random
import re

HOSTILE = (
    *(b"", b"0", b"-1", b"1e308", b"-1e308", b"nan", b"inf", b"1e-320", b"9" * 40, b"2147483648"),
    *(b"1e18", b"1e-300", b"1e6", b"3.5", b"0x10", b"9223372036854775808"),
    *(b"null", b"None", b"true", b"[]", b"[[1]]", b"{}", b'""', b"'", b'"', b"\x00", b"&", b"="),
    *(b"%s%n", b"%s%n%p", b"../../etc/passwd", b"/dev/zero", b"\x1b[2J", b"\xff\xfe", b"<a/>"),
    *(b"\xf0\x9f\xa4\x96", b"\xc3\xa9", b"world", b"1,5", b"1 2 3", b"x" * 5000, b"[[[[[[[["),
    *(b"__import__('os')", b"\r\n\r\n", b"1970-01-01"),
)
LENGTHS = (0, 1, 2**7, 2**15, 2**31 - 1, 2**31, 2**32 - 1, 2**62)
TOKEN = re.compile(rb"[-+.\w]+|\"[^\"\n]*\"|'[^'\n]*'")


def mutant(content, rng, binary=False):
    """`content` (bytes) with one to three changes, drawn from a `random.Random`."""
    for _ in range(rng.randint(1, 3)):
        change = rng.choice(_OF_BINARY if binary else _OF_TEXT)
        if content:
            content = change(content, rng)
    return content


def mutants(text, count, seed):
    """Mutants (bytes) of a text, the same for the same seed."""
    rng = random.Random(seed)
    return [mutant(text.encode(), rng) for _ in range(count)]


def _flip(content, rng):
    changed = bytearray(content)
    for _ in range(rng.randint(1, 8)):
        changed[rng.randrange(len(changed))] = rng.randrange(256)
    return bytes(changed)


def _cut(content, rng):
    return content[: rng.randrange(len(content))]


def _repeat(content, rng):
    first, last = sorted(rng.choices(range(len(content) + 1), k=2))
    return content[:last] + content[first:]


def _remove(content, rng):
    first = rng.randrange(len(content))
    return content[:first] + content[first + rng.randint(1, 200) :]


def _insert(content, rng):
    place = rng.randint(0, len(content))
    return content[:place] + rng.choice(HOSTILE) + content[place:]


def _number(content, rng):
    """A length, count or offset of a binary format is replaced by another."""
    width = rng.choice((1, 2, 4, 8))
    place = rng.randrange(max(1, len(content) - width))
    value = rng.choice(LENGTHS) % 256**width
    return content[:place] + value.to_bytes(width, "little") + content[place + width :]


def _token(content, rng):
    """A token becomes a hostile one or another token of the file."""
    tokens = list(TOKEN.finditer(content))
    if not tokens:
        return _insert(content, rng)
    old = rng.choice(tokens)
    new = rng.choice(tokens).group() if rng.random() < 0.3 else rng.choice(HOSTILE)
    return content[: old.start()] + new + content[old.end() :]


def _lines(content, rng):
    """Some lines are removed, repeated or moved."""
    lines = content.splitlines(keepends=True)
    first = rng.randrange(len(lines))
    last = first + rng.choice((1, 1, 3, 10))
    taken = lines[first:last]
    del lines[first:last]
    for _ in range(rng.choice((0, 1, 2, 2, 50))):
        place = rng.randint(0, len(lines))
        lines[place:place] = taken
    return b"".join(lines)


_OF_BINARY = (_flip, _flip, _number, _number, _cut, _repeat, _remove, _insert)
_OF_TEXT = (_token, _token, _token, _lines, _flip, _cut, _repeat, _insert)
