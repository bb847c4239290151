"""Reading of published models: URDFs in ROS packages, and meshes that MuJoCo can't read."""

from __future__ import annotations

import math
import os
import re
import warnings
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from sim.robot.model_check import (
    PLACES,
    MeshSizes,
    absolute,
    asset_folders,
    check_model,
    lies_in,
    model_folders,
    model_text,
    parsed,
)
from trackslip.errors import RobotWarning, TrackslipError, counted
from trackslip.inputs import note_input

_READABLE = (".stl", ".obj", ".msh")
_COMPILER = '<compiler strippath="false" discardvisual="false" '
_MAX_FACES = 200_000  # MuJoCo's limit for an .stl file
_STL_HEAD, _STL_FACE = 84, 50  # size of a binary .stl's header, and of each face [bytes]
_HEAD = 1_000_000  # of a package.xml or a .dae, whose unit is at the top [bytes]
_MAX_LENGTH: Final = 20.0  # of a mesh; robots reach up to 10 m to either side [m]
_SHOWN = 3  # most names listed in a message
_POINTER = b"version https://git-lfs"
_UNFETCHED = "a Git LFS pointer to the file: run `git lfs pull`"
_LIMIT: Final = re.compile(r"<limit\b[^>]*>")
_LARGE: Final = re.compile(r"[+-]?\d+(?:\.\d*)?[eE]\+?\d{3,}")  # from 1e100 on
_HUGE: Final = 1e300  # largest limit, which MuJoCo reads
_VALID_NAMES: Final = re.compile(r" ?Valid names: \[.*", re.DOTALL)
_WEIGHTLESS: Final = re.compile(r"mjMINVAL.*?Element name '([^']*)'", re.DOTALL)
_FROM_GEOMS = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE


ENGINE_ERRORS: Final = (
    ValueError,
    KeyError,
    AttributeError,
    OSError,
    RuntimeError,
    MemoryError,
    mujoco.FatalError,
    mujoco.UnexpectedError,
)
"""What MuJoCo raises for a model that it can't build or simulate."""
Refuse = Callable[[str], None]
"""Handler for a line on what is wrong with a robot and how to mend it."""


def refuse(line: str) -> None:
    """Raise a TrackslipError with this line as its message."""
    raise TrackslipError(line)


def read_model(path: Path, locked: Collection[str] = (), packages: Sequence[Path] = ()) -> Any:
    """Read an MJCF or URDF file as a `mujoco.MjSpec`; the meshes of a URDF keep their folders.

    In a URDF, links without <inertial> have no mass if they are fixed or will be `locked`; moving
    ones weigh as much as water, with a RobotWarning. Raises TrackslipError for a missing file, for
    xacro, for files of other kinds, and what `check_model` raises.
    """
    if not os.path.exists(path):  # Path.exists fails for long names
        raise TrackslipError(
            f"{path}: no such file; `model` must name the robot's MJCF or URDF file"
        )
    if _is_pointer(path):
        raise TrackslipError(f"{path}: is {_UNFETCHED}")
    text = model_text(path)
    if "<xacro:" in text:
        raise TrackslipError(
            f"{path}: is xacro; run `xacro {path.name} > robot.urdf`, and name its result as "
            "`model`"
        )
    element = re.search(r"<([A-Za-z][\w:.-]*)", text)
    root = element[1] if element else ""
    if root == "sdf":
        raise TrackslipError(
            f"{path}: is SDF; run `sdf2mjcf {path.name} robot.xml` of gz-mujoco, and name its "
            "result as `model`"
        )
    if root not in ("mujoco", "robot"):
        kind = f"is XML of <{root}>" if root else "is no XML"
        raise TrackslipError(
            f"{path}: {kind}; `model` must be an MJCF (<mujoco>) or URDF (<robot>): convert it"
        )
    folders = model_folders(path, packages)
    if root == "mujoco":
        check_model(text, path, folders)
        return mujoco.MjSpec.from_file(str(path))
    if "<link" not in text:
        raise TrackslipError(
            f"{path}: has no links; if it is from xacro, its macros must be called as <xacro:NAME/>"
        )
    text = _LIMIT.sub(lambda limit: _LARGE.sub(_clipped, limit[0]), _unstripped(text))
    check_model(text, path, folders)
    robot = parsed(path, text)
    _require_unique(robot, path)
    _require_expanded(robot, path)
    _require_masses(robot, path)
    _require_tree(robot, path)
    spec = mujoco.MjSpec.from_string(text)
    stated = any(body.explicitinertial for body in spec.bodies)
    water = []
    for geom in list(spec.geoms):
        link = geom.parent
        if geom.type == mujoco.mjtGeom.mjGEOM_SPHERE and not geom.size[0]:
            spec.delete(geom)  # only marks a point
        elif stated and not link.explicitinertial and (not link.joints or link.name in locked):
            geom.mass = 0  # the URDF standard's rule; MuJoCo would use the density of water
        elif not link.explicitinertial and geom.contype:
            water.append(link.name)
    if water:
        links = some(list(dict.fromkeys(water)))
        warnings.warn(
            f"{path}: links without <inertial>, {links}, weigh as water does",
            RobotWarning,
            stacklevel=4,
        )
    return spec


def _clipped(number: re.Match[str]) -> str:
    """A number that MuJoCo can read: those of endless joints may be too large for it."""
    value = float(number[0])
    return number[0] if abs(value) <= _HUGE else f"{math.copysign(_HUGE, value):g}"


def _require_unique(robot: Element, path: Path) -> None:
    """Raise TrackslipError for links or joints of a URDF's <robot> with the same name."""
    for tag in ("link", "joint"):
        names = [element.get("name", "") for element in robot.findall(tag)]
        repeated = [name for name, count in Counter(names).items() if count > 1]
        if repeated:
            times = Counter(names)[repeated[0]]
            raise TrackslipError(
                f"{path}: <{tag}> name = {some(repeated)}: {times} of {repeated[0]!r}, must be "
                "unique"
            )


def _require_expanded(robot: Element, path: Path) -> None:
    """Raise TrackslipError for a link or joint with an expression that xacro would replace."""
    for part in (*robot.findall("link"), *robot.findall("joint")):
        for element in part.iter():
            for name, value in element.items():
                if "${" in value or "$(" in value:
                    raise TrackslipError(
                        f"{path}: {part.tag} {part.get('name', '')!r}: <{element.tag}> {name} = "
                        f"{value[:80]!r}: is xacro; run `xacro` on the file that it comes from, "
                        "and name its result as `model`"
                    )


def _require_masses(robot: Element, path: Path) -> None:
    """Raise TrackslipError for a link with a negative mass, for which MuJoCo takes 0."""
    for link in robot.findall("link"):
        mass = link.find("inertial/mass")
        value = "" if mass is None else mass.get("value", "")
        try:
            is_negative = float(value) < 0
        except ValueError:
            continue  # MuJoCo names what isn't a number
        if is_negative:
            raise TrackslipError(
                f"{path}: link {link.get('name', '')!r}: mass = {value}: must be at least 0 kg"
            )


def _require_tree(robot: Element, path: Path) -> None:
    """Raise TrackslipError for a joint without links of the model, and for one by which the robot
    moves over the ground.

    MuJoCo lets the first link move freely if it is called anything but "world".
    """
    links = [link.get("name", "") for link in robot.findall("link")]
    joints = robot.findall("joint")
    children = {_end(joint, "child") for joint in joints}
    for joint in joints:
        where = f"{path}: joint {joint.get('name', '')!r}"
        for end in ("parent", "child"):
            name = _end(joint, end)
            if name not in links:
                raise TrackslipError(
                    f"{where}: {end} = {name!r}: must be a link of the model, such as {some(links)}"
                )
        kind = joint.get("type", "")
        parent = _end(joint, "parent")
        is_root = parent not in children
        if parent != "world" and (kind == "floating" or (kind == "planar" and is_root)):
            raise TrackslipError(
                f'{where}: type = {kind!r}: must be "fixed", as the robot moves freely without it; '
                f"or leave out the joint and {parent!r}"
            )


def _end(joint: Element, end: str) -> str:
    """The name of the link at the "parent" or "child" end of a URDF's joint."""
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def _head(path: Path) -> str:
    """The beginning of an XML file, with its comments blanked out."""
    note_input(path)
    with path.open("rb") as file:
        text = file.read(_HEAD).decode("utf-8-sig", errors="replace")
    return re.sub(r"<!--.*?(?:-->|\Z)", "", text, flags=re.DOTALL)


def _unstripped(text: str) -> str:
    """The text of a URDF, changed so that MuJoCo keeps its visuals and the folders of its
    meshes.
    """
    text = re.sub(r"\b(?:strippath|discardvisual)\s*=\s*(?:\"[^\"]*\"|'[^']*')", "", text)
    text = re.sub(r"<mujoco\s*/>", "", text)
    for tag, place in (("<compiler", "<compiler"), ("</mujoco>", "<compiler/></mujoco>")):
        if tag in text:
            return text.replace(tag, place.replace("<compiler", _COMPILER), 1)
    return text.replace("</robot>", f"<mujoco>{_COMPILER}/></mujoco></robot>")


def weightless(spec: Any, geom: Any) -> bool:
    """Whether a geom neither collides nor has mass."""
    measured = spec.compiler.inertiafromgeom == _FROM_GEOMS
    massless = (
        geom.mass == 0 or geom.density == 0 or (geom.parent.explicitinertial and not measured)
    )
    return bool(geom.contype == geom.conaffinity == 0 and massless)


def find_meshes(spec: Any, model: Path, packages: Sequence[Path], refuse: Refuse = refuse) -> None:
    """Point meshes to files that MuJoCo can read; drop purely visual meshes without such a file.

    Calls `refuse` for a mesh without such a file that collides or has mass.
    """
    folder = model.absolute().parent
    kinds = (
        ("texture", spec.textures, spec.texturedir),
        ("height field", spec.hfields, spec.meshdir),
    )
    for kind, things, place in kinds:
        for thing in things:
            if thing.file and _is_pointer(folder / place / thing.file):
                refuse(
                    f"{model}: {kind} {thing.name!r} needs {thing.file[-100:]}, but it is "
                    f"{_UNFETCHED}"
                )
                thing.file = ""
    sizes = MeshSizes()
    left_out: dict[str, str] = {}
    for mesh in [mesh for mesh in spec.meshes if mesh.file]:
        geoms = [geom for geom in spec.geoms if geom.meshname == mesh.name]
        file, wrong = _mesh_file(mesh.file, model, packages, spec.meshdir) if geoms else (None, "")
        if file:
            sizes.add(file)
            mesh.file = os.path.abspath(file)
            solid = [geom.parent.name for geom in geoms if not weightless(spec, geom)]
            length = _largest_extent(file, mesh.scale) if solid else 0.0
            if length > _MAX_LENGTH:
                refuse(
                    f"{model}: mesh {file.name[-100:]} of link {solid[0]!r} is {length:.4g} m "
                    f"long, must be at most {_MAX_LENGTH:g} m; if its numbers are in mm, state "
                    'scale="0.001 0.001 0.001"'
                )
            continue
        for geom in geoms:
            if weightless(spec, geom):
                left_out[mesh.file.rpartition("/")[2]] = wrong
            else:
                link = (
                    f"{model}: link {geom.parent.name!r} needs {mesh.file[-100:]} to collide "
                    "or for its mass"
                )
                refuse(f"{link}, but {wrong}")
            spec.delete(geom)
        spec.delete(mesh)
    if left_out:
        files = f"{counted(len(left_out), 'mesh file')} ({some(sorted(left_out))})"
        why = "; ".join(sorted(set(left_out.values()))[:_SHOWN])
        warnings.warn(f"{model}: shown without {files}: {why}", RobotWarning, stacklevel=2)


def _mesh_file(
    file: str, model: Path, packages: Sequence[Path], meshdir: str
) -> tuple[Path | None, str]:
    """A mesh file that MuJoCo can read, such as an .stl or .obj beside a .dae, and ""; or None and
    the reason.
    """
    folder = model.absolute().parent
    scheme, _, rest = file.rpartition("://")
    if scheme in ("package", "model"):
        name, _, rest = rest.partition("/")
        homes = (*packages, folder, *folder.parents)
        folders = [home for home in homes if name in (home.name, _package_name(home))] + [
            home / name for home in homes
        ]
        if name in ("", ".", ".."):
            folders = []
        inside = [each for each in folders if lies_in(each / rest, [absolute(each)])]
        tried = [each / rest for each in inside]
        there = next((each for each in folders if each.is_dir()), None)
        wrong = f"there is none; `packages` must list the folder of {name}, or the one it lies in"
        if there:
            wrong = f"package {name} in {str(there)[-100:]} has no {rest[-100:]}"
    else:
        places = [folder / meshdir / rest, folder / rest, folder / meshdir / Path(rest).name]
        allowed = asset_folders(model, packages)
        tried = [place for place in places if lies_in(place, allowed)]
        wrong = f"there is no {str(places[0])[-100:]}"
        if not lies_in(places[0], allowed):
            wrong += f" {PLACES}"
    for path in tried:
        beside = [Path(os.path.splitext(path)[0] + suffix) for suffix in _READABLE]
        for each in (path, *beside):
            if os.path.isfile(each) and _is_readable(each):
                unit = _unit(path)
                scale = (
                    f'name {each.name} in the model, scale="{unit} {unit} {unit}" unless its '
                    "numbers are in metres"
                )
                if float(unit) != 1 and each != path:
                    return (
                        None,
                        f"{path.name} is in units of {unit} m, and {each.name} has no unit: "
                        f"{scale}",
                    )
                return each, ""
        if os.path.isfile(path):
            if _is_pointer(path):
                return None, f"{path.name} is {_UNFETCHED}"
            kind = (
                "such an .stl (ASCII, damaged, or over 200,000 faces)"
                if path.suffix.lower() == ".stl"
                else path.suffix
            )
            return (
                None,
                f"MuJoCo doesn't read {kind}; convert it to an .obj or .stl of the same name "
                "beside it",
            )
    return None, wrong


def _largest_extent(path: Path, scale: Sequence[float]) -> float:
    """Largest side of the box around a binary .stl [m]; 0 for other files, whose points only MuJoCo
    reads.
    """
    if path.suffix.lower() != ".stl":
        return 0.0
    # each face has a normal, three points and two bytes more
    face = np.dtype([("normal", "<f4", 3), ("points", "<f4", (3, 3)), ("rest", "<u2")])
    points = np.fromfile(path, face, offset=_STL_HEAD)["points"].reshape(-1, 3)
    extents = np.ptp(points.astype(float), axis=0) * np.abs(scale)
    return float(extents.max())


def _is_pointer(path: Path) -> bool:
    """Whether a file is a pointer, which Git LFS leaves in place of a file that it hasn't
    fetched.
    """
    if not os.path.isfile(path):
        return False
    with path.open("rb") as file:
        return file.read(len(_POINTER)) == _POINTER


def _unit(path: Path) -> str:
    """The unit of length in a COLLADA file [m], which converted meshes lose; "1" for other
    files.
    """
    if path.suffix.lower() != ".dae" or not os.path.isfile(path):
        return "1"
    unit = re.search(r"<unit\b[^>]*\bmeter\s*=\s*[\"']\s*([\d.]+(?:[eE][+-]?\d+)?)", _head(path))
    return unit[1] if unit else "1"


def _is_readable(path: Path) -> bool:
    """Whether MuJoCo can read a mesh file; an .stl must be binary and have at most 200,000
    faces.
    """
    if path.suffix.lower() != ".stl":
        return path.suffix.lower() in _READABLE and not _is_pointer(path)
    with path.open("rb") as file:
        faces = int.from_bytes(file.read(_STL_HEAD)[80:], "little")
    is_whole = path.stat().st_size == _STL_HEAD + _STL_FACE * faces
    return 0 < faces <= _MAX_FACES and is_whole


def _package_name(folder: Path) -> str:
    """The package name in a folder's package.xml, or "" if there is none."""
    file = folder / "package.xml"
    name = re.search(r"<name>\s*([^<\s]+)\s*</name>", _head(file)) if file.is_file() else None
    return name[1] if name else ""


def some(names: Sequence[str]) -> str:
    """The first few names, and the number of those left out."""
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more


@contextmanager
def engine_errors(path: Path) -> Iterator[None]:
    """Turn MuJoCo's errors into a TrackslipError with a one-line message that names the file."""
    try:
        yield
    except TrackslipError:
        raise
    except ENGINE_ERRORS as error:
        raise TrackslipError(f"{path}: {_in_one_line(str(error))}") from error


def _in_one_line(message: str) -> str:
    """A message of MuJoCo in one line, with what to write where its own doesn't tell."""
    if found := _WEIGHTLESS.search(message):
        return (
            f"link {found[1]!r} moves, but weighs nothing: give it <inertial> with a mass and an "
            'inertia, or make its joint type="fixed"'
        )
    short = _VALID_NAMES.sub("", message)
    return " ".join(short.split()).removeprefix("Error: ")
