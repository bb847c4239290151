"""Write the API pages: every public name of each package, grouped by subpackage.

Run `python tests/helpers/api_pages.py` after a public name has come, moved or gone; a test says
when.
"""

import importlib
import inspect
from pathlib import Path

PACKAGES = {
    "trackslip": "Localization, identification, slip laws, controllers and logs. It needs no "
    "simulator.",
    "sim": "The simulated world: robots, grounds, drives, the laser range finder and closed loops.",
    "sim.tracks": "Tracks for any MuJoCo robot; see [the guide](../tracks.md).",
    "sim.terrain": "Courses for robots to cross; see [the guide](../tracks.md#terrain).",
}
FIRST = {"trackslip": "trackslip.identification.identify.identify"}
"""Names that most readers look for, which stand first on their pages."""
FOLDER = Path(__file__).parents[2] / "docs" / "api"


def page(package: str) -> str:
    """Markdown that lists every public name of a package.

    Raises:
        AttributeError: if `__all__` has a name that the package doesn't give.
    """
    lines = [
        f"# {package}",
        "",
        f"{PACKAGES[package]} `from {package} import NAME` gives every name on this page. Units "
        "are SI, angles are in "
        "radians, and tracks are ordered (left, right) on the last axis.",
    ]
    front = FIRST.get(package)
    if front:
        lines += ["", f"## {front.rpartition('.')[2]}", "", f"::: {front}"]
    for room, names in rooms(package).items():
        lines += ["", f"## {room}"]
        names = [name for name in names if name != front]
        for name in names:
            lines += ["", f"::: {name}"]
    return "\n".join(lines) + "\n"


def rooms(package: str) -> dict[str, list[str]]:
    """Full names of a package's public names, by the subpackage or module that defines them."""
    front_door = importlib.import_module(package)
    found: dict[str, list[str]] = {}
    for name in sorted(getattr(front_door, "__all__", ()), key=str.lower):
        if name.startswith("__"):
            continue
        value = getattr(front_door, name)
        home = value.__name__ if inspect.ismodule(value) else getattr(value, "__module__", package)
        room = ".".join(home.split(".")[: package.count(".") + 2])
        found.setdefault(room, []).append(home if inspect.ismodule(value) else f"{home}.{name}")
    return dict(sorted(found.items()))


def main() -> None:
    FOLDER.mkdir(exist_ok=True)
    for package in PACKAGES:
        (FOLDER / f"{package}.md").write_text(page(package), encoding="utf-8")


if __name__ == "__main__":
    main()
