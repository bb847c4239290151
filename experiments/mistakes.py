"""What tyro says in a box about a mistake in the options, as a line."""

from __future__ import annotations

import ast
import re

_KINDS = {
    "INT": "an integer",
    "FLOAT": "a number",
    "[INT [INT ...]]": "integers",
    "[FLOAT [FLOAT ...]]": "numbers",
}


def sentence(box: str, command: str) -> str:
    """The box's first paragraph, in the words that all other mistakes are told in.

    Args:
        box: with or without lines around it and colours in it, as the terminal can draw.
        command: whose options they are.
    """
    paragraphs = _paragraphs(box)
    said = " ".join(paragraphs[0])
    option = next((text.split(maxsplit=1) for text in _after(paragraphs, "Argument helptext:")), None)
    if option is not None and (given := _given(said)) is not None:
        kind = re.sub(r"^\{None\}\||[{}]", "", option[1])
        return f"{option[0]} = {given!r}: must be {_KINDS.get(kind, kind)}"
    if said.startswith("Unrecognized options:"):
        return f"{said}; {f'trackslip {command}'.strip()} --help lists what there is"
    # name nested fields as the options are: 'Error parsing X.ground: along = -1' -> 'ground.along = -1'
    nested = re.match(r"Error parsing [\w-]+\.([\w.]+): (?=\w+ = )", said)
    if nested:
        return f"{nested[1]}.{said[nested.end() :]}"
    return re.sub(r"^Error parsing (?:\w+: (?=[\w.]+ = ))?", "", said)


def _paragraphs(box: str) -> list[list[str]]:
    """Lines of text, without what is drawn around and between them."""
    box = re.sub(r"\x1b\[[0-9;]*m", "", box)
    found: list[list[str]] = [[]]
    for line in box.splitlines():
        text = line.strip().strip("│").strip()
        if line.startswith("╭") or set(text) <= set("-─╰╯"):
            found.append([])
        else:
            found[-1].append(text)
    filled = [lines for lines in found if lines]
    return filled if "╭" in box else filled[1:]  # without lines, the title is a paragraph


def _after(paragraphs: list[list[str]], title: str) -> list[str]:
    return next((lines[1:] for lines in paragraphs if lines[0] == title), [])


def _given(said: str) -> str | None:
    """What was given for an option of another type."""
    if several := re.search(r"(?:parse for arguments:|instantiated from) (\[.*\])\.?$", said):
        return " ".join(ast.literal_eval(several[1]))
    if single := re.search(r"(?:to float|with base 10): (['\"].*['\"])$", said):
        return str(ast.literal_eval(single[1]))
    return None
