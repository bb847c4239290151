"""Checks of MJCF and URDF files before MuJoCo reads them, as a model may come from a stranger.

MuJoCo 4.0.0 prints the name of an unknown default class as a printf format, opens any file that a
model names, follows models that attach themselves without end, and builds whatever counts and sizes
a model asks for, without reacting to signals. `check_model` refuses such models with one line.
"""

from __future__ import annotations

import math
import os
import re
import stat
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from trackslip.errors import TrackslipError
from trackslip.inputs import note_input

MAX_TEXT: Final = 32_000_000
"""Largest MJCF or URDF file; published ones have up to 1 MB, and saved meshes up to 10 [bytes]."""
MAX_DEPTH: Final = 200
"""Most elements inside each other; robots have up to 60. MuJoCo allows 500."""
MAX_ELEMENTS: Final = 5_000
"""Most elements of a model, repeated and attached ones included: published robots have up to 2,000.
The slowest 10,000, geoms that are only drawn, take 40 s to delete.
"""
MAX_NUMBER: Final = 1e18
"""Largest magnitude of a number: its square fits in a 32-bit float, and robots have up to 1e16."""
MAX_FILE: Final = 64_000_000
"""Largest file of a mesh, texture or height field, over six times MuJoCo's largest .stl [bytes]."""
MAX_FILES: Final = 256_000_000
"""Size of all mesh files of a model; those of large published robots have 100 MB [bytes]."""
MAX_PIXELS: Final = 2**28
"""Most pixels in all textures, 16 pictures of 4096 x 4096, which take 1.6 GB while they load."""
MAX_CELLS: Final = 2**22
"""Most samples of all height fields, one of 2048 x 2048."""
MAX_VERTICES: Final = 200_000
"""Most vertices of all meshes without files: their convex hulls take 4 s, as those of an .stl."""
FLEX_POINT: Final = 2
"""Elements for which a point of a soft body counts: MuJoCo makes a body of it with a joint."""
MAX_FLEX_FILE: Final = 20_000
"""Largest file of a soft body, which has at most a point in eight bytes [bytes]."""
MIN_TIMESTEP: Final = 1e-5
"""Shortest physics step of a model, a hundredth of what robots need [s]."""
MIN_MEMORY: Final = 2**20
"""Smallest `memory` of a model: without room for the contacts of its tracks, some are left out
[bytes].
"""
MAX_MEMORY: Final = 2**30
"""Largest `memory` of a model, a hundred times what robots need [bytes]."""
MAX_RANGE_STEPS: Final = 10_000
"""Most steps in a search for an actuator's range; MuJoCo's default is 1,000."""
MAX_COUNTS: Final = {
    "size": {
        "nkey": 1_000,  # takes 0.1 s; 1e5 take 18 s
        "nuserdata": 100_000,
        "njmax": 100_000,
        "nconmax": 100_000,
        "nstack": 100_000_000,
    },
    "option": {
        name: 10_000  # 100 times MuJoCo's defaults, in every step
        for name in (
            "iterations",
            "ls_iterations",
            "noslip_iterations",
            "ccd_iterations",
            "sdf_iterations",
            "sdf_initpoints",
        )
    },
    "global": {"offwidth": 8192, "offheight": 8192},
    "quality": {
        "shadowsize": 16_384,
        "offsamples": 64,
        "numslices": 1_000,
        "numstacks": 1_000,
        "numquads": 1_000,
    },
    "camera": {"resolution": 4_096},  # a range finder has a ray per pixel
    "contact": {"num": 1_000},
    "user": {"dim": 1_000},
    "numeric": {"size": 10_000},
    "mesh": {"maxhullvert": 100_000},
    "texture": {"width": 8_192, "height": 6 * 8_192, "gridsize": 100},
}
"""Largest counts by element and attribute."""
MAX_COUNTS_ANYWHERE: Final = {"nsample": 1_000, "actdim": 1_000}
"""Largest counts by attribute, of any element."""
MAX_USER_VALUES: Final = 100
"""Largest of the attributes nuser_body, nuser_geom, …, of which every element gets as many."""

PLACES: Final = (
    "in the model's folder, in its ROS package or in a folder that the robot file lists in "
    "`packages`"
)
"""Where the files of a model may lie, for messages."""
_PICTURE: Final = b"\x89PNG\r\n\x1a\n"
_UNITS: Final = {unit: 1024 ** (k + 1) for k, unit in enumerate("KMGTPE")}  # of `memory`
_COMMENT: Final = re.compile(r"<!--.*?(?:-->|\Z)", re.DOTALL)
_WHOLE: Final = re.compile(r"\s*[+-]?\d{1,18}\s*")


def model_text(path: Path) -> str:
    """The text of an MJCF or URDF file, with empty comments, as these may contain what XML forbids.

    Raises TrackslipError for what isn't a regular file, and for a file of more than MAX_TEXT bytes.
    """
    _require_small(path, MAX_TEXT)
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    return _COMMENT.sub(lambda comment: f"<!--{_line_breaks(comment[0])}-->", text)


def _line_breaks(text: str) -> str:
    """The line breaks of a text, which keep the numbers of the lines that follow it."""
    return "\n" * text.count("\n")


def _require_small(path: Path, most: int) -> int:
    """The size of a regular file; raises TrackslipError for others and for larger files [bytes]."""
    try:
        found = path.stat()
    except OSError as error:
        raise TrackslipError(f"{path}: {error.strerror}") from error
    if not stat.S_ISREG(found.st_mode):
        raise TrackslipError(f"{path}: not a regular file")
    if found.st_size > most:
        raise TrackslipError(f"{path}: {found.st_size:,} bytes long, must be at most {most:,}")
    note_input(path)
    return found.st_size


def model_folders(model: Path, packages: Sequence[Path]) -> tuple[Path, ...]:
    """Folders in which the XML files of a model may lie: its own, that of its ROS package, and
    `packages`.
    """
    folder = absolute(model).parent
    holding = [each for each in (folder, *folder.parents) if (each / "package.xml").is_file()]
    return (folder, *holding[:1], *(absolute(each) for each in packages))


def asset_folders(model: Path, packages: Sequence[Path]) -> tuple[Path, ...]:
    """Folders in which meshes and pictures of a model may lie: also the one above the model's, as
    the folders urdf and meshes lie beside each other.
    """
    return (*model_folders(model, packages), absolute(model).parent.parent)


def absolute(path: Path) -> Path:
    """An absolute path without "..", whose symbolic links are kept: links may lead anywhere, as
    those of an installed ROS workspace do.
    """
    return Path(os.path.abspath(path))


def lies_in(path: Path, folders: Sequence[Path]) -> bool:
    """Whether a path lies in one of these folders, which are absolute."""
    return any(absolute(path).is_relative_to(folder) for folder in folders)


def check_model(text: str, path: Path, folders: Sequence[Path]) -> None:
    """Check the text of an MJCF or URDF file, with the files that it includes and attaches.

    Mesh files are checked where they are found, see `MeshSizes`.

    Raises:
        TrackslipError: for text that isn't XML or has a DOCTYPE, a CDATA section or instructions;
            for % in names; numbers that aren't finite or too large; counts and sizes above the
            limits of this module; files outside of `folders`, that aren't regular or too large; and
            models that include or attach themselves.
    """
    _Model(path, tuple(folders)).check(text)


def parsed(path: Path, text: str | None = None) -> Element:
    """The elements of an MJCF or URDF file, or of its `text` if that was changed; raises
    TrackslipError for what isn't XML.

    Only the children of a URDF's <robot> are its links and joints: <transmission>, <ros2_control>
    and <gazebo> repeat the names of joints in elements of their own.
    """
    return _Model(path, ()).parse(model_text(path) if text is None else text, path)


@dataclass
class MeshSizes:
    """The sizes of a model's mesh files."""

    total: int = 0  # [bytes]

    def add(self, file: Path) -> None:
        """Count a mesh file; raises TrackslipError if it isn't a regular file, or too large."""
        self.total += _require_small(file, MAX_FILE)
        if self.total > MAX_FILES:
            raise TrackslipError(
                f"{file}: with it, mesh files have {self.total:,} bytes, must be at most "
                f"{MAX_FILES:,}"
            )


@dataclass(frozen=True)
class _Load:
    """What a model makes MuJoCo build."""

    elements: int = 0
    pixels: int = 0
    cells: int = 0
    vertices: int = 0

    def __add__(self, other: _Load) -> _Load:
        return _Load(
            self.elements + other.elements,
            self.pixels + other.pixels,
            self.cells + other.cells,
            self.vertices + other.vertices,
        )

    def larger(self, other: _Load) -> _Load:
        """The larger of each number."""
        return _Load(
            max(self.elements, other.elements),
            max(self.pixels, other.pixels),
            max(self.cells, other.cells),
            max(self.vertices, other.vertices),
        )


@dataclass
class _Model:
    """An MJCF or URDF file that is being checked."""

    path: Path
    folders: tuple[Path, ...]
    """Absolute folders in which files may lie."""
    above: tuple[Path, ...] = ()
    """Models that attach this one, directly or not."""
    attached: dict[Path, _Load] = field(default_factory=dict)
    """The models that were checked because others attach them."""
    included: set[Path] = field(default_factory=set)
    elements: int = 0
    """Number of elements in the model's files."""
    attachable: _Load = field(default_factory=_Load)
    """At least what the largest of the models is that this one may attach."""

    def check(self, text: str) -> _Load:
        """Check the model and return what it makes MuJoCo build; see `check_model`."""
        self.included.add(absolute(self.path))
        root = self.parse(text, self.path)
        if root.tag == "mujoco":
            self._include(root, self.path, depth=0)
        for element in root.iter():
            for name, value in element.items():
                self._check_value(element, name, value)
        # MuJoCo reads no other files of a URDF than meshes, see `MeshSizes`
        files = self._files(root) if root.tag == "mujoco" else _Load()
        load = self._built(root) + files + _Load(pixels=self._drawn_pixels(root))
        for count, most, what in (
            (load.elements, MAX_ELEMENTS, "elements, repeated and attached ones included"),
            (load.pixels, MAX_PIXELS, "pixels of textures"),
            (load.cells, MAX_CELLS, "samples of height fields"),
            (load.vertices, MAX_VERTICES, "vertices of meshes without files"),
        ):
            if count > most:
                shown = f"{count:,}" if count < 10**15 else "over 1e15"
                self._refuse(f"{shown} {what}: must be at most {most:,}")
        return load

    def _refuse(self, what: str) -> None:
        raise TrackslipError(f"{self.path}: {what}")

    def parse(self, text: str, path: Path) -> Element:
        """The elements of an XML text."""
        builder = TreeBuilder()
        open_elements = 0
        parser = expat.ParserCreate("utf-8")

        def start(tag: str, attributes: dict[str, str]) -> None:
            nonlocal open_elements
            open_elements += 1
            self.elements += 1
            if open_elements > MAX_DEPTH or self.elements > MAX_ELEMENTS:
                raise TrackslipError(
                    f"{path}: line {parser.CurrentLineNumber}: must have at most {MAX_ELEMENTS:,} "
                    f"elements, and at most {MAX_DEPTH} inside each other"
                )
            builder.start(tag, attributes)

        def end(tag: str) -> None:
            nonlocal open_elements
            open_elements -= 1
            builder.end(tag)

        def unneeded(*_: object) -> None:
            # MuJoCo reads elements inside of a DOCTYPE, which no other program sees
            raise TrackslipError(
                f"{path}: line {parser.CurrentLineNumber}: DOCTYPE, CDATA and processing "
                "instructions are refused; models need none of them"
            )

        parser.StartElementHandler, parser.EndElementHandler = start, end
        parser.StartDoctypeDeclHandler = unneeded
        parser.StartCdataSectionHandler = unneeded
        parser.ProcessingInstructionHandler = unneeded
        try:
            parser.Parse(text.encode(errors="replace"), True)
        except expat.ExpatError as error:
            raise TrackslipError(f"{path}: not XML ({error})") from error
        return builder.close()

    def _include(self, element: Element, including: Path, depth: int) -> None:
        """Replace the elements <include> inside an element by the contents of their files."""
        if depth > MAX_DEPTH:
            self._refuse(f"must have at most {MAX_DEPTH} elements inside each other")
        for child in list(element):
            if child.tag != "include":
                self._include(child, including, depth + 1)
                continue
            name = child.get("file", "")
            self._check_value(child, "file", name)
            file = self._found(child, name, (self.path.parent, including.parent))
            if file is None:
                self._refuse(f"<include> file = {name!r}: no such file")
                return
            if file in self.included:
                self._refuse(f"<include> file = {name!r}: included twice, must be included once")
            self.included.add(file)
            content = self.parse(model_text(file), file)
            self._include(content, file, depth + 1)
            place = list(element).index(child)
            element[place : place + 1] = list(content)

    def _check_value(self, element: Element, name: str, value: str) -> None:
        """Check an attribute: its text, its numbers, and its value if it is a count."""
        where = f"<{element.tag}> {name} = {value[:80]!r}"
        if "%" in value:
            self._refuse(f"{where}: must be free of %, which MuJoCo may read as a printf format")
        limits = element.tag == "limit"  # of a URDF's joint: those of endless joints are huge
        for number in _numbers(value):
            if not math.isfinite(number) or (abs(number) > MAX_NUMBER and not limits):
                self._refuse(f"{where}: numbers must be finite, from -1e18 to 1e18")
        most = MAX_COUNTS.get(element.tag, {}).get(name, MAX_COUNTS_ANYWHERE.get(name))
        if name.startswith("nuser_"):
            most = MAX_USER_VALUES
        if most is not None and any(number > most for number in _numbers(value)):
            self._refuse(f"{where}: must be at most {most:,}")
        match element.tag, name:
            case "option", "timestep":
                if any(number < MIN_TIMESTEP for number in _numbers(value)):
                    self._refuse(f"{where}: must be at least {MIN_TIMESTEP:g} s")
            case "size", "memory":
                memory = _bytes(value)
                if memory is not None and not MIN_MEMORY <= memory <= MAX_MEMORY:
                    self._refuse(f"{where}: must be from 1M to 1G")
            case "lengthrange", "timestep" | "inttotal":
                step, total = (
                    next(_numbers(element.get(each, default)), 1.0)
                    for each, default in (("timestep", "0.01"), ("inttotal", "10"))
                )
                if total > MAX_RANGE_STEPS * step:
                    self._refuse(f"{where}: inttotal must be at most {MAX_RANGE_STEPS:,} timesteps")

    def _file_folders(self, root: Element) -> tuple[Path, ...]:
        """Folders in which MuJoCo may look for a file of this model."""
        names = {
            element.get(name, "")
            for element in root.iter("compiler")
            for name in ("assetdir", "meshdir", "texturedir")
        }
        return tuple(self.path.parent / name for name in ("", *sorted(names - {""})))

    def _found(self, element: Element, name: str, folders: Sequence[Path]) -> Path | None:
        """The file with this name, or None if there is none in `folders`.

        Raises TrackslipError if it would lie outside of the model's folders.
        """
        is_text = element.tag in ("include", "model")
        allowed = self.folders if is_text else asset_folders(self.path, self.folders)
        tried = [absolute(folder / name) for folder in folders]
        for file in tried:
            if not lies_in(file, allowed):
                self._refuse(f"<{element.tag}> file = {name[-100:]!r}: must lie {PLACES}")
        return next((file for file in tried if os.path.lexists(file)), None)

    def _files(self, root: Element) -> _Load:
        """Check the files that a model names, and the models that it attaches."""
        folders, load = self._file_folders(root), _Load()
        for element in root.iter():
            if element.tag == "mesh":
                continue  # see `MeshSizes`
            for attribute, name in element.items():
                if attribute.startswith("file") and (file := self._found(element, name, folders)):
                    load += self._file(element, file)
        return load

    def _file(self, element: Element, file: Path) -> _Load:
        """Check a file that an element names."""
        if element.tag == "model":
            return self._attach(file)
        size = _require_small(file, MAX_FLEX_FILE if element.tag == "flexcomp" else MAX_FILE)
        rows, columns = _picture_size(file)
        if element.tag == "hfield":
            return _Load(cells=rows * columns or size // 4)
        return _Load(pixels=rows * columns)

    def _attach(self, file: Path) -> _Load:
        """Check a model that this one attaches."""
        chain = (*self.above, absolute(self.path))
        if file in chain or len(chain) > MAX_DEPTH:
            self._refuse(f"<model> file = {file.name!r}: attaches itself")
        if file not in self.attached:
            other = _Model(file, (*self.folders, file.parent), chain, self.attached)
            self.attached[file] = other.check(model_text(file))
        load = self.attached[file]
        self.attachable = self.attachable.larger(load)
        return load

    def _drawn_pixels(self, root: Element) -> int:
        """Number of pixels of textures without files, each as large as the largest, as they may
        inherit their size.
        """
        textures = list(root.iter("texture"))
        drawn = [
            each for each in textures if not any(name.startswith("file") for name in each.attrib)
        ]
        sizes = []
        for each in textures:
            width, height = self._whole(each, "width", 0), self._whole(each, "height", 0)
            cube = each.get("type", "cube") != "2d"
            sizes.append(width * max(height, 6 * width if cube else 0))
        return len(drawn) * max(sizes, default=0)

    def _built(self, element: Element) -> _Load:
        """What MuJoCo builds of an element and of those inside it, without files."""
        load = _Load(elements=1)
        for child in element:
            load += self._built(child)
        match element.tag:
            case "replicate":
                times = max(1, self._whole(element, "count", 1))
                return replace(load, elements=times * load.elements)
            case "attach":
                return load + self.attachable
            case "flexcomp" | "flex":
                points = sum(
                    math.prod(self._wholes(element, name))
                    for name in ("count", "cellcount")
                    if name in element.attrib
                )
                points += len(element.get("point", "").split()) // 3
                return load + _Load(elements=FLEX_POINT * points)
            case "hfield":
                rows, columns = (self._whole(element, name, 0) for name in ("nrow", "ncol"))
                return load + _Load(cells=rows * columns)
            case "mesh" if "builtin" in element.attrib:
                # all kinds have fewer vertices than the square of one of their first two numbers
                counts = [abs(number) for number in _numbers(element.get("params", ""))][:2]
                return load + _Load(vertices=int(max(counts, default=0.0) ** 2))
            case "mesh":
                return load + _Load(vertices=len(element.get("vertex", "").split()) // 3)
            case _:
                return load

    def _whole(self, element: Element, name: str, default: int) -> int:
        """A whole number, or the default; raises TrackslipError for other values."""
        return next(iter(self._wholes(element, name)), default)

    def _wholes(self, element: Element, name: str) -> tuple[int, ...]:
        """The whole numbers in an attribute, none without the attribute; raises TrackslipError for
        other values.
        """
        values = element.get(name, "").split()
        if not all(_WHOLE.fullmatch(value) for value in values):
            self._refuse(f"<{element.tag}> {name} = {' '.join(values)[:80]!r}: must be whole")
        return tuple(int(value) for value in values)


def _numbers(value: str) -> Iterator[float]:
    """The numbers in an attribute, as MuJoCo reads them."""
    for word in value.split():
        try:
            yield float.fromhex(word) if "0x" in word.lower() else float(word)
        except ValueError:
            if word.lower().lstrip("+-").startswith("nan("):
                yield math.nan
        except OverflowError:
            yield math.inf


def _bytes(memory: str) -> int | None:
    """The bytes that `memory` asks for, such as 16M; None for -1 and for what MuJoCo can't read."""
    number = re.fullmatch(r"\s*\+?(\d{1,18})\s*([KMGTPE]?)\s*", memory, re.IGNORECASE)
    return int(number[1]) * _UNITS.get(number[2].upper(), 1) if number else None


def _picture_size(file: Path) -> tuple[int, int]:
    """Rows and columns of a picture, by its header; zeros for files of other kinds than .png."""
    with file.open("rb") as opened:
        head = opened.read(24)
    if not head.startswith(_PICTURE) or len(head) < 24:
        return 0, 0
    columns, rows = struct.unpack(">II", head[16:24])
    return rows, columns
