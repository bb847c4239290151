"""Damaged and hostile variants of every kind of file that the commands read, each read by a process
of its own with limits on time and memory.

`python tests/helpers/file_mutants.py COUNT [SEED] [KIND ...]` prints every failure and the counts.
"""

import collections
import contextlib
import io
import json
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from mutants import mutant

from experiments.cli import main  # imported before processes are forked
from experiments.train.training import UNFINISHED

ROOT = Path(__file__).parents[2]
LOGS = ROOT / "examples" / "logs"
MODELS = ROOT / "models"
MOST_SECONDS = 60.0
MOST_MEMORY = 4e9  # resident [bytes]
ADDRESSES = 16_000_000_000  # limit on the address space, which includes what isn't used [bytes]

DATASET = """title = "Warthog on grass"
log = "log.parquet"
source = "github.com/norlab-ulaval/DRIVE"
licence = "BSD-3-Clause"
robot = ["warthog"]
ground = "grass"
[[bounds]]
row = "robot"
quantity = "position_median"
most = 9.0
"""


LOG = ("log", "FILE")
TRACK = ("track", "--localization", "truth")
SHORT = ("--reference", "circle", "--circle-duration", "2")
TRAINING = (
    *("train", "--robots", "2", "--horizon", "32", "--batch", "32", "--epochs", "1"),
    *("--network", "8", "--references", "slalom", "--threads", "1"),
)


@dataclass(frozen=True)
class Kind:
    """A sound example of a kind of file, and the command lines that read it, with FILE for its
    path, FOLDER for that of its folder, and UNFINISHED for a folder of results with the file as its
    checkpoint.
    """

    example: Path
    commands: tuple[tuple[str, ...], ...]
    binary: bool = False


def kinds(folder: Path, names: list[str]) -> dict[str, Kind]:
    """Those of the kinds `names` for which packages are installed, and some more; their examples
    are in a folder.
    """
    found = {}
    for made, make in MAKERS.items():
        if set(made) & set(names):
            found |= make(folder)
    return found


def _logs(folder: Path) -> dict[str, Kind]:
    """A drive as CSV and as Parquet."""
    import pyarrow as pa
    import pyarrow.csv
    import pyarrow.parquet

    rows = pa.parquet.read_table(LOGS / "warthog_grass.parquet").slice(0, 700)
    parquet = folder / "log.parquet"
    pa.parquet.write_table(rows, parquet)
    csv = folder / "log.csv"
    pa.csv.write_csv(rows, csv)
    geometry = ("--half-gauge", "0.54", "--sprocket-radius", "0.3")
    identify = ("identify", "FILE", *geometry, "--laws", "icr")
    return {"csv": Kind(csv, (LOG, identify)), "parquet": Kind(parquet, (LOG,), binary=True)}


def _results(folder: Path) -> dict[str, Kind]:
    """What a grid and an identification store."""
    grid = folder / "grid"
    _run("grid", "--radii", "0.6", "1.5", "--speeds", "0.2", "--duration", "4", "--out", grid)
    found = folder / "found"
    _run("identify", grid, "--out", found)
    identify = ("identify", "FILE")
    with_its_laws = (*TRACK, *SHORT, "--laws", "FILE")
    deploy = ("deploy", "FILE", "--out", "dd.yaml")
    log = ("log", "FOLDER")
    predict = ("predict", "--out", "FOLDER")
    return {
        "runs": Kind(grid / "runs.parquet", (LOG, identify), binary=True),
        "summary": Kind(found / "summary.json", (with_its_laws, deploy)),
        "manifest": Kind(grid / "manifest.json", (log, predict)),
    }


def _settings(folder: Path) -> dict[str, Kind]:
    """Files that a user writes for a run of `track`."""
    path = folder / "path.csv"
    path.write_text("x,y\n0,0\n0.7,0.1\n1.4,0.45\n2,1\n")
    ground = folder / "ground.toml"
    ground.write_text("along = 0.7\nacross = 0.6\nshear = 0.01\n")
    posts = folder / "posts.toml"
    posts.write_text("posts = [{x = 1, y = 2.0}]\n")
    return {
        "path": Kind(path, ((*TRACK, "--reference", "FILE"),)),
        "ground": Kind(ground, ((*TRACK, *SHORT, "--ground", "FILE"),)),
        "posts": Kind(posts, ((*TRACK, *SHORT, "--obstacles", "FILE"),)),
    }


def _shipped(_: Path) -> dict[str, Kind]:
    """Courses, robots and a sweep."""
    course, *_ = sorted((MODELS / "courses").glob("*.toml"))
    drive = ("drive", "--course", "FILE", "--duration", "1")
    check = ("drive", "--robot", "FILE", "--check")
    check_model = ("drive", "--robot", "ROBOT", "--check")
    sweep = ("grid", "--sweep", "FILE", "--duration", "0.2", "--radii", "1", "--speeds", "0.2")
    return {
        "course": Kind(course, (drive,)),
        "robot": Kind(MODELS / "husky.toml", (check,)),
        "tracked": Kind(MODELS / "box_robot.toml", (check,)),
        "mjcf": Kind(MODELS / "box_robot.xml", (check_model,)),
        "sweep": Kind(ROOT / "examples" / "sensitivity.toml", (sweep,)),
    }


def _evaluated(folder: Path) -> dict[str, Kind]:
    """A data set."""
    dataset = folder / "dataset.toml"
    dataset.write_text(DATASET)
    return {"dataset": Kind(dataset, (("evaluate", "FILE"),))}


def _recorded(folder: Path) -> dict[str, Kind]:
    """A bag that `track` writes."""
    track = folder / "track"
    _run("track", *SHORT, "--bag", "--out", track)
    return {"mcap": Kind(next(track.rglob("*.mcap")), (LOG,), binary=True)}


def _trained(folder: Path) -> dict[str, Kind]:
    """A learned policy and the checkpoint of its training, if stable-baselines3 is installed."""
    try:
        import stable_baselines3  # noqa: F401
    except ImportError:
        return {}
    out = folder / "policy"
    _run(*TRAINING, "--steps", "64", "--out", out)
    track = ("track", "--controller", "ppo:FOLDER", *SHORT)
    resume = (*TRAINING, "--steps", "128", "--resume", "--out", "UNFINISHED")
    return {
        "policy": Kind(out / "policy.npz", (track,), binary=True),
        "checkpoint": Kind(out / "checkpoint.npz", (resume,), binary=True),
    }


def _bags(folder: Path) -> dict[str, Kind]:
    """Bags as ROS 1 and sqlite3 write them, if rosbags is installed."""
    with contextlib.suppress(ImportError):
        from bags import JOINT_NAMES, JOINTS, STAMPED, START, write_bag

        messages = []
        for k in range(40):
            stamp = START + k * 50_000_000
            header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": "map"}
            joints = {"header": header, "name": list(JOINT_NAMES), "position": [0.1 * k, 0.12 * k]}
            pose = {"position": {"x": 0.01 * k}, "orientation": {"w": 1.0}}
            messages.append(("/joint_states", JOINTS, stamp, joints))
            messages.append(("/pose", STAMPED, stamp, {"header": header, "pose": pose}))
        one = write_bag(folder / "one", "ros1", messages, compression="bz2")
        two = write_bag(folder / "two", "sqlite3", messages)
        return {
            "ros1": Kind(one, (LOG,), binary=True),
            "db3": Kind(next(two.glob("*.db3")), (LOG,), binary=True),
            "metadata": Kind(two / "metadata.yaml", (("log", "FOLDER"),)),
        }
    return {}


MAKERS = {
    ("csv", "parquet"): _logs,
    ("runs", "summary", "manifest"): _results,
    ("path", "ground", "posts"): _settings,
    ("course", "robot", "tracked", "mjcf", "sweep"): _shipped,
    ("dataset",): _evaluated,
    ("mcap",): _recorded,
    ("ros1", "db3", "metadata"): _bags,
    ("policy", "checkpoint"): _trained,
}
NAMES = [name for names in MAKERS for name in names]


def _run(*arguments: object) -> None:
    with contextlib.redirect_stdout(io.StringIO()):
        main([str(one) for one in arguments])


def outcome(kind: Kind, content: bytes, command: tuple[str, ...], folder: Path) -> str:
    """What happens when a mutant is read: "" if all is well, otherwise the kind of failure.

    The folder gets the mutant, beside the example's neighbours, and the command's output.
    """
    beside = folder / "beside"
    if _needs_neighbours(command, kind):
        shutil.copytree(kind.example.parent, beside)
    beside.mkdir(exist_ok=True)
    file = beside / kind.example.name
    file.unlink(missing_ok=True)
    file.write_bytes(content)
    robot = file.with_suffix(".toml")
    places = {"FILE": str(file), "FOLDER": str(beside), "ROBOT": str(robot)}
    if "UNFINISHED" in command:
        places["UNFINISHED"] = str(folder / "unfinished")
        checkpoint = folder / "unfinished" / UNFINISHED
        checkpoint.parent.mkdir(parents=True)
        checkpoint.write_bytes(content)
    arguments = [places.get(word, word) for word in command]
    child = os.fork()
    if child == 0:
        _become(arguments, folder)
    status, usage = _waited(child)
    if status is None:
        return "hang"
    text = (folder / "stderr").read_text(errors="replace")
    if os.WIFSIGNALED(status):
        return f"signal {os.WTERMSIG(status)}"
    if "Traceback" in text or os.WEXITSTATUS(status) not in (0, 2):
        last = text.strip().splitlines()[-1:] or [""]
        return f"exit {os.WEXITSTATUS(status)}: {last[0][:160]}"
    if usage.ru_maxrss * 1024 > MOST_MEMORY:
        return f"memory {usage.ru_maxrss / 1e6:.1f} GB"
    return ""


def _needs_neighbours(command: tuple[str, ...], kind: Kind) -> bool:
    return "FOLDER" in command or "ROBOT" in command or kind.example.suffix in (".toml", ".xml")


def _become(arguments: list[str], folder: Path) -> None:
    """Run a command in this process, which ends with it."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
    os.chdir(folder)
    for stream, name in ((1, "stdout"), (2, "stderr")):
        os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), stream)
    code = 1
    try:
        main(arguments)
        code = 0
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else 1
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _waited(child: int) -> tuple[int | None, resource.struct_rusage]:
    deadline = time.monotonic() + MOST_SECONDS
    while time.monotonic() < deadline:
        pid, status, usage = os.wait4(child, os.WNOHANG)
        if pid:
            return status, usage
        time.sleep(0.002)
    os.kill(child, signal.SIGKILL)
    _, _, usage = os.wait4(child, 0)
    return None, usage


def failures(count: int, seed: int, names: list[str], keep: Path | None = None) -> dict[str, str]:
    """Failures among `count` mutants of the kinds `names`, or of all: texts by kind and number.

    A mutant depends on the seed, its kind and its number only. Those that fail are copied to
    `keep`.
    """
    found = {}
    with tempfile.TemporaryDirectory() as place:
        (Path(place) / "examples").mkdir()
        wanted = (names or NAMES)[:count]
        by_name = kinds(Path(place) / "examples", wanted)
        chosen = [name for name in wanted if name in by_name]
        for number in range(count):
            name = chosen[number % len(chosen)]
            kind = by_name[name]
            rng = random.Random(f"{seed} {number} {name}")
            content = mutant(kind.example.read_bytes(), rng, kind.binary)
            command = rng.choice(kind.commands)
            with tempfile.TemporaryDirectory(dir=place) as folder:
                failure = outcome(kind, content, command, Path(folder))
                if failure and keep:
                    keep.mkdir(exist_ok=True)
                    (keep / f"{name}_{number}{kind.example.suffix}").write_bytes(content)
            if failure:
                found[f"{name} {number} {' '.join(command)}"] = failure
                print(f"{name} {number} {' '.join(command)}: {failure}", flush=True)
    return found


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    given = [int(word) for word in sys.argv[1:3]]
    began = time.perf_counter()
    seed = given[1] if len(given) > 1 else 0
    result = failures(given[0], seed, sys.argv[3:], Path("mutants"))
    counts = collections.Counter(key.split()[0] for key in result)
    print(json.dumps({"mutants": given[0], "failures": counts}))
    print(f"{time.perf_counter() - began:.0f} s")
