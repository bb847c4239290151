"""Mutants of text files: bytes changed, words replaced by hostile values, lines repeated, left out
or cut off.
"""

import random
import re

HOSTILE = (
    *("0", "-1", "1e308", "-1e308", "inf", "nan", "1e18", "1e-300", "999999999999999999999"),
    *("0,5", "%s%n", "%p", "true", "[]", "{}", "[[1]]", "../../x", "/etc/passwd", '""', "a" * 300),
    *("3.5", "1e6", "world", "<a/>", "&", "'", "=", "é", "0x10", "1979-05-27"),
)
WORD = re.compile(r"[-+.\w]+")


def mutant(text, rng):
    """Bytes of a mutant of a text, drawn from a `random.Random`."""
    lines = text.splitlines(keepends=True)
    first = rng.randrange(len(lines))
    last = first + rng.choice((1, 1, 3, 10))
    match rng.choice(("bytes", "words", "words", "words", "end", "repeat", "remove")):
        case "bytes":
            content = bytearray(text.encode())
            for _ in range(rng.choice((1, 3, 20))):
                content[rng.randrange(len(content))] = rng.randrange(256)
            return bytes(content)
        case "words":
            for _ in range(rng.choice((1, 1, 2, 5))):
                word = rng.choice(list(WORD.finditer(text)))
                text = text[: word.start()] + rng.choice(HOSTILE) + text[word.end() :]
        case "end":
            text = text[: rng.randrange(len(text))]
        case "repeat":
            repeated = lines[first:last] * rng.choice((2, 3, 50))
            text = "".join([*lines[:first], *repeated, *lines[last:]])
        case "remove":
            text = "".join([*lines[:first], *lines[last:]])
    return text.encode()


def mutants(text, count, seed):
    """Mutants of a text, the same for the same seed."""
    rng = random.Random(seed)
    return [mutant(text, rng) for _ in range(count)]
