"""Make the pictures of the README and the documentation: `python docs/images/make.py [NAME ...]`.

A picture is drawn from what a command has found: its content, as text. `made.json` has the digest
of the content with which each picture was drawn, so that a picture whose content is another now is
stale: `--check` prints the stale ones. Pixels aren't compared, as they depend on the machine.

Needs Chromium for the pictures of pages, and OpenGL and Vulkan, by a graphics card or by Mesa.
"""

import argparse
import contextlib
import hashlib
import io
import json
import os
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, Final

os.environ.setdefault("MUJOCO_GL", "egl")  # before MuJoCo is imported
FOLDER: Final = Path(__file__).parent
ROOT: Final = FOLDER.parents[1]
if str(FOLDER) not in sys.path:
    sys.path.insert(0, str(FOLDER))
sys.path.insert(0, str(ROOT / "examples"))

import animation
import mujoco
import numpy as np
from browser import View, address, browser
from matplotlib.image import imsave
from PIL import Image
from rerun.chunk import RrdReader

from experiments.cli import main as trackslip
from experiments.cli import parse
from experiments.common.laws import shown
from experiments.common.traces import Traces
from experiments.drive.course import DrivenCourse, drive_course
from experiments.drive.pictures import write_pictures
from experiments.drive.world import driver, make_world
from experiments.recorder.run import series_of
from sim.engine.opengl import Pictures, place
from sim.path_tracking.renderer import draw_path
from sim.robot.looks import robot_looks
from sim.robot.named import load_parameters
from sim.robot.robot import load_robot
from sim.robot.tracked_model import build_tracked
from trackslip import paper_reference, se2
from trackslip.logs.logfile import read_runs

MADE: Final = FOLDER / "made.json"
_LOGS: Final = ROOT / "examples" / "logs"
_FIELD: Final = 1280, 640  # width and height of the picture of the field [px]
_FIELD_TIME: Final = 9.0  # time of the robot on its path [s]
_BEAMS: Final = 13  # number of beams that are drawn
_REPORT: Final = View(1120)
_REPORT_HEIGHT: Final = 1460  # [px]
_DARK: Final = View(960, dark=True)
_VIEWER: Final = 1600  # width of the picture of the viewer [px]
_SHOWN_TIME: Final = 14.0  # time at which the viewer is shown [s]
_LOADING: Final = 12.0  # time after which the viewer's notices have gone [s]
_PORT: Final = 9878  # of the viewer


@dataclass(frozen=True)
class Drawing:
    """A picture to be drawn."""

    content: str
    """What it shows, as text that is the same on every machine."""
    draw: Callable[[Path], Any]
    """Writes the picture to a file."""

    @property
    def digest(self) -> str:
        """A short hash of the content."""
        return hashlib.sha256(self.content.encode()).hexdigest()[:16]


@cache
def result(*arguments: str) -> Path:
    """The results folder of a command, which is run once, as a user would, in a folder of its
    own.
    """
    work = Path(tempfile.mkdtemp(prefix="trackslip-images-"))
    typed = sys.argv
    sys.argv = ["trackslip", *arguments]  # which pages show
    try:
        with contextlib.chdir(work), contextlib.redirect_stdout(io.StringIO()):
            trackslip(list(arguments))
    finally:
        sys.argv = typed
    return work / "out" / arguments[0]


def _rounded(values: Any, digits: int) -> str:
    """Numbers as text, rounded so that they are the same on every machine."""
    return json.dumps((np.round(np.asarray(values, float), digits) + 0.0).tolist())


def _animation() -> Drawing:
    ends = [_rounded(run.truth.pose[-1], 2) for run in animation.drive().values()]
    source = Path(animation.__file__).read_text(encoding="utf-8")
    return Drawing("\n".join([source, *ends]), animation.main)


def _field() -> Drawing:
    """The robot on the paper's path, in front of the laser range finder."""
    robot = load_robot()
    pose = paper_reference().pose(_FIELD_TIME)
    content = "\n".join([robot.digest, _rounded(pose, 3), _rounded(robot.lrf_mount, 3)])
    return Drawing(content, partial(_draw_field, pose))


def _draw_field(pose: np.ndarray, file: Path) -> None:
    parameters, _ = load_parameters("shipped")
    looks = robot_looks(parameters)
    model = looks.model
    model.vis.quality.offsamples = 8
    model.vis.global_.offwidth, model.vis.global_.offheight = _FIELD
    data = mujoco.MjData(model)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = -0.7, 0.5, 0.25
    camera.distance = 3.1
    camera.azimuth = 200.0
    camera.elevation = -18.0
    pictures = Pictures(model, *_FIELD)
    path = paper_reference()
    line = path.pose(np.linspace(0.0, path.duration, 300))[:, :2]

    def draw(scene: mujoco.MjvScene) -> None:
        draw_path(scene, line)
        _draw_beams(scene, model, pose)
        looks.draw(scene, data, np.zeros(len(looks.tracks)))

    place(data, looks.qpos(pose))
    imsave(file, pictures.take(data, camera, draw))
    pictures.close()


def _draw_beams(scene: mujoco.MjvScene, model: mujoco.MjModel, pose: np.ndarray) -> None:
    """Append the beams from the scanner to the plate of a robot at a pose (3,)."""
    lrf = model.body("lrf").pos
    half = float(model.geom("plate").size[0])
    kind = mujoco.mjtGeom.mjGEOM_CAPSULE
    for share in np.linspace(-1.0, 1.0, _BEAMS):
        hit = se2.to_world(pose, [share * half, 0.0])
        geom = scene.geoms[scene.ngeom]
        colour = np.array([1.0, 0.24, 0.5, 0.45])
        mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), colour)
        mujoco.mjv_connector(geom, kind, 0.002, lrf, np.array([*hit, lrf[2]]))
        scene.ngeom += 1


def _report(view: View, place_of: str, file_height: int | None) -> Drawing:
    """A part of the report of reproduce, from the element `place_of` on."""
    report = result("reproduce") / "report.html"
    page = report.read_text(encoding="utf-8").partition("How it was made")[0]
    without = re.sub(r"<(script|svg)\b.*?</\1>", "", page, flags=re.DOTALL)
    return Drawing(without, partial(_draw_page, report, view, place_of, file_height))


def _draw_page(report: Path, view: View, place_of: str, height: int | None, file: Path) -> None:
    with browser() as chrome:
        chrome.open(address(report), view)
        box = f"document.querySelector('{place_of}').getBoundingClientRect()"
        top = int(chrome.value(f"{box}.top"))
        height = int(chrome.value(f"{box}.height")) if height is None else height
        file.write_bytes(chrome.picture(view, height, top))
    _shrink(file)


def _shrink(file: Path) -> None:
    """Write a picture with a palette, which takes a third of the room."""
    with Image.open(file) as picture:
        small = picture.convert("RGB").quantize(256, dither=Image.Dither.NONE)
    small.save(file, optimize=True)


def _rerun() -> Drawing:
    """The viewer with a run along the paper's path, from a start beside it."""
    start = ("--start", "0.3", "-0.2", "1.0472", "--obstacles", "posts")
    out = result("track", *start, "--rrd")
    (log,) = read_runs(out / "runs.parquet")
    lines = [f"{line.entity} {line.names} {line.colours}" for line in series_of(Traces(log))]
    assert log.truth is not None
    poses = _rounded(log.truth.pose[::100], 2)
    (recording,) = (out / "recordings").glob("*.rrd")
    content = [*lines, poses, *_shapes(recording)]
    return Drawing("\n".join(content), partial(_draw_viewer, recording))


def _shapes(recording: Path) -> list[str]:
    """What stays in a recording, as the robot's parts: its place, and what it is made of, such as
    Cylinders3D:radii.
    """
    found = set()
    for chunk in RrdReader(recording).stream():
        parts = chunk.to_record_batch().schema.names if chunk.is_static else ()
        found.update(f"{chunk.entity_path} {part}" for part in parts if ":" in part)
    return sorted(found)


def _ruts() -> Drawing:
    """The viewer with a run on snow, and the ruts that the robot leaves."""
    circle = ("--reference", "circle", "--circle-radius", "0.8", "--circle-duration", "20")
    out = result("track", "--ground", "soft_snow", *circle, "--rrd")
    (log,) = read_runs(out / "runs.parquet")
    assert log.truth is not None
    assert log.truth.sinkage is not None
    depths = _rounded(log.truth.sinkage[::100], 3)
    poses = _rounded(log.truth.pose[::100], 2)
    (recording,) = (out / "recordings").glob("*.rrd")
    content = [depths, poses, *_shapes(recording)]
    return Drawing("\n".join(content), partial(_draw_viewer, recording))


def _drawbar() -> Drawing:
    """Drawbar tests on sand, and theory."""
    straight = ("--ground", "dry_sand", "--radii", "1000", "--speeds", "0.1", "--duration", "24")
    forces = "pull.force=0,20,40,80,110,130,145,160,172"
    out = result("grid", *straight, "--pull.since", "1", "--vary", forces)
    (test,) = json.loads((out / "summary.json").read_text(encoding="utf-8"))["drawbar"]
    names = ("drawbar_slip", "sinkage", "resistance", "efficiency")
    content = [f"{name} {_rounded_known(test[name], 3)}" for name in names]
    titles = ("drawbar_pull", "tractive_efficiency", "sinkage", "resistance")
    figures = [out / "figures" / f"drawbar_{title}.svg" for title in titles]
    return Drawing("\n".join(content), partial(_draw_svgs, figures, 2))


def _rounded_known(values: Iterable[float | None], digits: int) -> str:
    """Numbers as `_rounded` has them, of which some may be unknown."""
    return json.dumps([None if value is None else round(value, digits) for value in values])


def _draw_viewer(recording: Path, file: Path) -> None:
    from rerun.experimental import ViewerClient

    program = Path(sys.executable).with_name("rerun")
    with ViewerClient.spawn(
        headless=True, port=_PORT, executable_path=str(program), hide_welcome_screen=True
    ) as viewer:
        viewer.open(str(recording))
        viewer.set_time("time", duration=_SHOWN_TIME, play_state="paused")
        time.sleep(_LOADING)
        file.write_bytes(viewer.take_screenshot(max_size=_VIEWER))
    _shrink(file)


def _evaluation(folder: Path, name: str, digits: int, words: Iterable[str]) -> Drawing:
    """A figure of an evaluation, with the errors of its models."""
    models = json.loads((folder / "summary.json").read_text(encoding="utf-8"))["models"]
    content = [*words]
    for label, model in models.items():
        content.append(f"{label} {shown(model['law']).colour}")
        for ahead in ("after_seconds", "after_metres"):
            for length, errors in model[ahead].items():
                parts = [errors[part] for part in ("position", "heading") if errors[part]]
                medians = [part["median"] for part in parts]
                content.append(f"{ahead} {length} {_rounded(medians, digits)}")
    return Drawing("\n".join(content), partial(_draw_svg, folder, name))


def _draw_svg(folder: Path, name: str, file: Path) -> None:
    """Draw the figures of a page whose names begin so, side by side."""
    figures = sorted((folder / "figures").glob(f"{name}*.svg"), reverse=True)
    _draw_svgs(figures, len(figures), file)


def _draw_svgs(figures: Sequence[Path], columns: int, file: Path) -> None:
    """Draw figures in some columns."""
    texts = [figure.read_text(encoding="utf-8") for figure in figures]
    drawn = "".join(f"<div>{text[text.index('<svg') :]}</div>" for text in texts)
    with tempfile.TemporaryDirectory() as draft:
        page = Path(draft) / "figure.html"
        across = f"repeat({columns},max-content)"
        style = "body{margin:0;background:#fff;display:grid;place-content:start;align-items:start;"
        style += f"grid-template-columns:{across}}}"
        style += "svg{display:block}"
        page.write_text(f"<meta charset=utf-8><style>{style}</style>{drawn}", encoding="utf-8")
        with browser() as chrome:
            view = View(3000, scale=1.5)
            chrome.open(address(page), view)
            right = "document.querySelector('div:last-of-type').getBoundingClientRect()"
            width = int(chrome.value(f"{right}.right"))
            height = int(chrome.value(f"{right}.bottom"))
            file.write_bytes(chrome.picture(View(width), height))
    _shrink(file)


def _real_robots() -> Drawing:
    size = ("--half-gauge", "0.54", "--sprocket-radius", "0.3")
    laws = str(result("identify", str(_LOGS / "warthog_grass.parquet"), *size))
    named = ("--law", laws, "--law", f"{laws}:turn_loss_sides", "--law", f"{laws}:icr_radius")
    log = str(_LOGS / "warthog_grass_2.parquet")
    return _evaluation(result("evaluate", log, *named, "--law", "none"), "paths", 2, ["paths"])


def _reality() -> Drawing:
    out = result("evaluate", str(_LOGS / "ice.toml"))
    return _evaluation(out, "errors_ahead", 2, ["errors"])


def _on_course(*options: str) -> Drawing:
    """The robot at the end of a drive."""
    config = parse(["drive", *options])
    world = make_world(config)
    run = drive_course(world, driver(config, world))
    course = world.course[0]
    looks = build_tracked(
        run.robot, course, preset=config.preset, friction=course.frictions, looks=True
    )
    content = f"{options} {_rounded(run.state.qpos[-1], 1)}"
    return Drawing(content, partial(_draw_course, run, looks))


def _draw_course(run: DrivenCourse, looks: Any, file: Path) -> None:
    with tempfile.TemporaryDirectory() as draft:
        (picture,) = write_pictures(Path(draft), run, looks, 1)
        file.write_bytes(picture.read_bytes())
    _shrink(file)


DRAWINGS: Final[dict[str, Callable[[], Drawing]]] = {
    "animation.gif": _animation,
    "field.png": _field,
    "report.png": partial(_report, _REPORT, "body", _REPORT_HEIGHT),
    "report_dark.png": partial(_report, _DARK, "#fig08_feedforward_paths", None),
    "rerun.png": _rerun,
    "ruts.png": _ruts,
    "drawbar.png": _drawbar,
    "real_robots.png": _real_robots,
    "reality.png": _reality,
    "rescue_robot.png": partial(
        _on_course, "--course", "flat", "--flippers", "up", "--duration", "2"
    ),
    "rescue_stairs.png": partial(_on_course, "--duration", "7"),
    "rescue_arena.png": partial(_on_course, "--course", "arena", "--duration", "9"),
}
"""What makes each picture, by the name of its file."""


def made() -> dict[str, str]:
    """Digests of the contents with which the pictures were drawn."""
    known: dict[str, str] = json.loads(MADE.read_text(encoding="utf-8")) if MADE.exists() else {}
    return known


def stale(names: Iterable[str]) -> list[str]:
    """The names of the pictures whose content is another now, or that are missing."""
    drawn = made()
    return [
        name
        for name in names
        if DRAWINGS[name]().digest != drawn.get(name) or not (FOLDER / name).exists()
    ]


def main(arguments: list[str] | None = None) -> int:
    """Make pictures, or with --check print the stale ones; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="files, by default all of them")
    parser.add_argument("--check", action="store_true", help="only print the stale pictures")
    given = parser.parse_args(arguments)
    names = given.names or list(DRAWINGS)
    for name in names:
        if name not in DRAWINGS:
            parser.error(f"{name}: one of {', '.join(DRAWINGS)}")
    if given.check:
        old = stale(names)
        print("\n".join(f"{name}: stale" for name in old) or "all pictures are up to date")
        return 1 if old else 0
    for name in names:
        drawing = DRAWINGS[name]()
        drawing.draw(FOLDER / name)
        digests = made() | {name: drawing.digest}
        text = json.dumps(dict(sorted(digests.items())), indent=2)
        MADE.write_text(text + "\n", encoding="utf-8")
        print(f"{name}: {(FOLDER / name).stat().st_size / 1e3:.0f} kB", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
