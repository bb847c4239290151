"""Store what the commands print and write, and compare two such stores, to show that a change loses nothing.

    python tests/stored_outputs.py store FOLDER [COMMAND ...]
    python tests/stored_outputs.py compare OLD NEW

A store has a folder for each entry of COMMANDS with what the command printed, `printed.txt`, and its results. `compare`
prints every number that differs by more than rounding, every line of text that differs and every file that only one
store has, and exits with 1 if there is any; times and versions don't count.
"""

import json
import math
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

COMMANDS = {
    "reproduce": "reproduce --seed 0 --out OUT",
    "grid": "grid --out OUT",
    "sweep": "grid --radii 0.5 1.5 --speeds 0.2 --duration 6 --grounds stone ice --vary scanner.noise=0.005,0.01 --bag"
    " --out OUT",
    "identify": "identify grid --out OUT",
    "track": "track --bag --out OUT",
    "track_online": "track --controller lqr --compensation online --reference slalom --out OUT",
    "benchmark": "benchmark --suite paper --out OUT",
    "benchmark_grounds": "benchmark --controllers linear lqr --references circle --grounds stone ice --seeds 0 1"
    " --out OUT",
    "wander": "wander --duration 60 --drives 2 --bag --out OUT",
    "identify_drive": "identify wander --out OUT",
    "identify_bags": "identify wander/bags --half-gauge 0.168 --sprocket-radius 0.06 --out OUT",
    "evaluate": "evaluate wander --law identify_drive --law none --out OUT",
    "export": "log wander --out OUT/log.csv",
    "bag": "log wander/bags/random_1 --out OUT/log.csv",
    "deploy_c": "deploy identify --to c --out OUT/slip.h",
    "deploy_python": "deploy identify --to python --out OUT/slip.py",
    "deploy_ros": "deploy identify --to ros2_control --out OUT/drive.yaml",
    "predict": "predict --shear 0.01 --slope 0.17",
    "calibrate": "calibrate --out OUT",
    "plan": "plan --half-gauge 0.168 --sprocket-radius 0.06 --max-speed 0.3 --duration 60 --out OUT",
    "drive": "drive --duration 20 --pictures 2 --out OUT",
    "view": "view track --save OUT/run.rrd",
    "validate": "validate --out OUT",
}
"""What is stored, by name: a command line in which OUT is its own folder, and other names are those of earlier ones."""

_UNTOLD = re.compile(
    r"(compute_ms|made_by|scans_per_s|time|timing|wall|seconds|stages|version|created|host|command|python|argv|cpu|git|/s$)"
)
_TIMES = re.compile(r"\d+(\.\d+)?(e-?\d+)? (s|ms|µs|MB|min)\b|stages?:.*|.*per second.*|[━╸╺─ ]{20,}|\d+:\d\d(:\d\d)?")
_RELATIVE, _ABSOLUTE = 1e-6, 1e-9


def store(folder: Path, names: list[str]) -> None:
    """Run the commands, or those named, in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    folder = folder.resolve()
    source = Path(__file__).parents[1]
    paths = [str(source), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "COLUMNS": "160", "NO_COLOR": "1"}

    def run(*arguments: str) -> str:
        command = [sys.executable, "-m", "experiments", *arguments]
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
        return f"{done.stdout}\n--- errors\n{done.stderr}\n--- exit {done.returncode}\n"

    for name in names or COMMANDS:
        (folder / name).mkdir(exist_ok=True)
        printed = run(*shlex.split(COMMANDS[name].replace("OUT", name)))
        (folder / name / "printed.txt").write_text(printed, encoding="utf-8")
        print(name, printed.strip().splitlines()[-1], flush=True)
    if not names:
        helps = folder / "help"
        helps.mkdir(exist_ok=True)
        for name in sorted({line.split()[0] for line in COMMANDS.values()} | {"train"}):
            (helps / f"{name}.txt").write_text(run(name, "--help"), encoding="utf-8")
        (helps / "trackslip.txt").write_text(run("--help"), encoding="utf-8")


def compare(old: Path, new: Path) -> bool:
    """Print what differs between two stores; whether nothing does."""
    same = True
    for name in sorted({path.name for path in (*old.iterdir(), *new.iterdir())}):
        files = [{str(path.relative_to(side / name)) for path in (side / name).rglob("*")} for side in (old, new)]
        differences = [f"only {who}: {file}" for who, file in _alone(*files)]
        for file in sorted(files[0] & files[1]):
            differences += _file_differences(old / name / file, new / name / file, file)
        for line in differences:
            print(f"{name}: {line}")
        same = same and not differences
    return same


def _alone(old: set[str], new: set[str]) -> Iterator[tuple[str, str]]:
    yield from (("old", file) for file in sorted(old - new))
    yield from (("new", file) for file in sorted(new - old))


def _file_differences(old: Path, new: Path, file: str) -> list[str]:
    if file.endswith("summary.json"):
        return list(_value_differences(*(json.loads(side.read_text()) for side in (old, new)), "summary"))
    if old.suffix in (".txt", ".csv", ".h", ".py", ".md", ".toml"):
        lines = [[_timeless(line) for line in side.read_text().splitlines()] for side in (old, new)]
        lines = [[line for line in some if line] for some in lines]
        return [f"{file}: only {who}: {line}" for who, line in _alone(*map(set, lines))]
    return []


def _timeless(line: str) -> str:
    """A printed line without times and spaces."""
    return " ".join(_TIMES.sub("", line).split())


def _value_differences(old: Any, new: Any, place: str) -> Iterator[str]:
    """Where two contents of a JSON file differ."""
    if isinstance(old, dict) and isinstance(new, dict):
        for who, key in _alone({*old}, {*new}):
            yield f"{place}.{key}: only {who}"
        for key in old.keys() & new.keys():
            if not _UNTOLD.search(key):
                yield from _value_differences(old[key], new[key], f"{place}.{key}")
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for at, (one, other) in enumerate(zip(old, new, strict=True)):
            yield from _value_differences(one, other, f"{place}[{at}]")
    elif isinstance(old, float) and isinstance(new, int | float):
        if not math.isclose(old, new, rel_tol=_RELATIVE, abs_tol=_ABSOLUTE):
            yield f"{place}: {old} | {new}"
    elif old != new:
        yield f"{place}: {old!r} | {new!r}"


if __name__ == "__main__":
    verb, *arguments = sys.argv[1:]
    if verb == "store":
        store(Path(arguments[0]), arguments[1:])
    elif not compare(*map(Path, arguments)):
        sys.exit(1)
