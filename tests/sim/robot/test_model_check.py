"""Models from strangers are refused with one line, before the engine reads them."""

import os
import struct
import warnings
from pathlib import Path

import pytest

from sim.robot.model_check import (
    MAX_COUNTS,
    MAX_COUNTS_ANYWHERE,
    MAX_ELEMENTS,
    MAX_FILE,
    MAX_TEXT,
    MeshSizes,
    check_model,
)
from sim.robot.named import load_tracked
from sim.robot.tracked_model import build_tracked
from trackslip.errors import TrackslipError

ROBOT = 'model = "m/{}"\nhalf_gauge = 0.3\nhull = [[-0.2, 0.0, 0.1], [0.2, 0.0, 0.1]]\n'
BODY = (
    '<body name="base"><geom name="hull" type="box" size=".2 .1 .05" pos="0 0 .1" mass="9"/>'
    "{}</body>"
)
MJCF = "<mujoco>{}<worldbody>" + BODY.format("{}") + "</worldbody></mujoco>"
INERTIAL = (
    '<inertial><mass value="9"/>'
    '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
)
URDF = f'<robot name="r"><link name="base">{INERTIAL}{{}}</link>{{}}</robot>'
CUBE = "".join(f"v {x} {y} {z}\n" for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (0.1, 0.2))
CUBE += "f 1 2 4 3\nf 5 7 8 6\nf 1 3 7 5\nf 2 6 8 4\nf 1 5 6 2\nf 3 4 8 7\n"
MESH = '<mesh name="a" file="{}"/>', '<geom type="mesh" mesh="a"/>'


@pytest.fixture
def build(tmp_path):
    """Write a model, in a folder m beside its robot file, and build the robot."""
    (tmp_path / "m").mkdir()

    def build(text, name="robot.xml", robot=""):
        (tmp_path / "m" / name).write_text(text)
        (tmp_path / "robot.toml").write_text(ROBOT.format(name) + robot)
        with warnings.catch_warnings(action="ignore"):
            return build_tracked(load_tracked(tmp_path / "robot.toml")).model

    return build


def mjcf(head="", inside=""):
    return MJCF.format(head, inside)


def test_the_models_of_these_tests_are_built_without_faults(build):
    assert build(mjcf()).nbody > 1
    assert build(URDF.format("", ""), "robot.urdf").nbody > 1


@pytest.mark.parametrize("name", ["%s%n%n%n", "%p", "a%", "&#37;p"])
@pytest.mark.parametrize(
    "text",
    [
        mjcf('<default><default class="{}"/></default>'),
        mjcf('<default><default class="a{}"><geom/></default></default>'),
        mjcf("", '<geom class="{}" size="1"/>'),
        mjcf("", '<body name="{}"/>'),
        mjcf('<asset><material name="a" class="{}"/></asset>'),
        mjcf('<asset><model name="a" file="{}"/></asset>'),
        mjcf('<include file="{}.xml"/>'),
        mjcf('<compiler meshdir="{}"/>'),
        mjcf('<actuator><motor class="{}" joint="a"/></actuator>'),
        URDF.format("", '<link name="{}"/>'),
        URDF.format('<visual><geometry><mesh filename="{}"/></geometry></visual>', ""),
    ],
)
def test_a_printf_format_in_a_name_is_refused(build, text, name):
    with pytest.raises(TrackslipError, match="must be free of %, which MuJoCo may read as a"):
        build(text.replace("{}", name), "robot.urdf" if "<robot" in text else "robot.xml")


def replicated(*counts):
    """Bodies that are repeated inside of each other."""
    body = '<body><geom size=".01" mass="1"/></body>'
    for count in counts:
        body = f'<replicate count="{count}" offset="0 0 1">{body}</replicate>'
    return mjcf("", body)


def asset(text):
    return mjcf(f"<asset>{text}</asset>")


def flexible(text):
    return mjcf("", f'<flexcomp name="f" type="grid" dim="2" spacing="1 1 1" {text}/>')


SIZES = [
    (replicated(100_000), "elements, repeated and attached ones included: must be at most 5,000"),
    (replicated(30, 30, 30), "elements, repeated"),
    (replicated(*[10**17] * 25), "over 1e15 elements, repeated"),
    (replicated("1e5"), "<replicate> count = '1e5': must be whole"),
    (mjcf("", "<body/>" * MAX_ELEMENTS), "line 1: must have at most 5,000 elements"),
    (mjcf("", "<body>" * 250 + "</body>" * 250), "at most 200 inside each other"),
    (mjcf('<size nkey="100000"/>'), "<size> nkey = '100000': must be at most 1,000"),
    (mjcf('<size memory="100G"/>'), "<size> memory = '100G': must be from 1M to 1G"),
    (mjcf('<size memory="20k"/>'), "<size> memory = '20k': must be from 1M to 1G"),
    (mjcf('<size nuser_geom="100000"/>'), "nuser_geom = '100000': must be at most 100"),
    (mjcf('<size njmax="1000000000"/>'), "njmax = '1000000000': must be at most 100,000"),
    (mjcf('<option iterations="1000000000"/>'), "iterations = .* must be at most 10,000"),
    (mjcf('<option timestep="1e-12"/>'), "timestep = '1e-12': must be at least 1e-05 s"),
    (mjcf('<sensor><user name="a" dim="100000000"/></sensor>'), "dim = .* at most 1,000"),
    (mjcf('<sensor><clock nsample="10000000"/></sensor>'), "nsample = .* at most 1,000"),
    (
        mjcf('<compiler><lengthrange timestep="1e-9"/></compiler>'),
        "inttotal must be at most 10,000 timesteps",
    ),
    (
        asset('<hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/>'),
        "10,000,000,000 samples of height fields: must be at most 4,194,304",
    ),
    (
        asset('<hfield name="h{}" nrow="2000" ncol="2000" size="1 1 1 1"/>' * 2),
        "8,000,000 samples of height fields",
    ),
    (asset('<texture builtin="flat" width="10000"/>'), "width = '10000': must be at most 8,192"),
    (asset('<texture builtin="flat" width="8000"/>'), "pixels of textures: must be at most"),
    (
        asset('<mesh name="a" builtin="supersphere" params="2000 1 1"/>'),
        "4,000,000 vertices of meshes without files: must be at most 200,000",
    ),
    (asset(f'<mesh name="a" vertex="{"0 " * 600_003}"/>'), "200,001 vertices of meshes"),
    (flexible('count="100 100 1"'), "elements, repeated"),
    (flexible('count="0 0 1" cellcount="100 100 100"'), "elements, repeated"),
    (URDF.format("", "<link/>" * MAX_ELEMENTS), "at most 5,000 elements"),
    (URDF.format("", '<mujoco><size nkey="100000"/></mujoco>'), "nkey = '100000'"),
]


@pytest.mark.parametrize(("text", "said"), SIZES, ids=[said[:40] for _, said in SIZES])
def test_sizes_are_bounded_before_anything_is_built(build, text, said):
    with pytest.raises(TrackslipError, match=said):
        build(text, "robot.urdf" if "<robot" in text else "robot.xml")


def checked(text):
    check_model(text, Path("m") / "robot.xml", ())


def repeated(count, more=""):
    """A model of 4 + 2 `count` elements, and `more`."""
    return mjcf("", f'{more}<replicate count="{count}"><geom/></replicate>')


def nested(count):
    """Bodies inside each other, inside three other elements."""
    return mjcf("", "<body>" * count + "</body>" * count)


def points(count):
    """A model of five elements and a soft body, whose points count twice."""
    return flexible(f'count="{count} 1 1"')


def textures(count):
    return asset('<texture type="2d" builtin="flat" width="8192" height="8192"/>' * count)


def samples(*rows):
    made = [f'<hfield name="h" nrow="{each}" ncol="2048" size="1 1 1 1"/>' for each in rows]
    return asset("".join(made))


def range_search(total):
    return mjcf(f'<compiler><lengthrange timestep="0.01" inttotal="{total}"/></compiler>')


@pytest.mark.parametrize(
    ("largest", "larger", "said"),
    [
        (repeated(2498), repeated(2498, "<site/>"), "5,001 elements, repeated and"),
        (points(2497), points(2498), "5,001 elements, repeated and"),
        (nested(197), nested(198), "at most 200 inside each other"),
        (textures(4), textures(5), "335,544,320 pixels of textures: must be at most 268,435,456"),
        (samples(1024, 1024), samples(1024, 1025), "4,196,352 samples of height fields: must"),
        (
            asset(f'<mesh name="a" vertex="{"0 " * 600_000}"/>'),
            asset(f'<mesh name="a" vertex="{"0 " * 600_003}"/>'),
            "200,001 vertices of meshes",
        ),
        (
            asset('<mesh name="a" builtin="supersphere" params="447 1 1"/>'),
            asset('<mesh name="a" builtin="supersphere" params="448 1 1"/>'),
            "200,704 vertices of meshes",
        ),
        (
            mjcf("", '<body pos="0 1e18 -1e18"/>'),
            mjcf("", '<body pos="0 -1.1e18 0"/>'),
            "pos = '0 -1.1e18 0': numbers must be finite, from -1e18 to 1e18",
        ),
        (mjcf('<option timestep="1e-5"/>'), mjcf('<option timestep="0.9e-5"/>'), "least 1e-05 s"),
        (mjcf('<size memory="1M"/>'), mjcf('<size memory="1023k"/>'), "must be from 1M to 1G"),
        (mjcf('<size memory="1G"/>'), mjcf('<size memory="1025M"/>'), "must be from 1M to 1G"),
        (range_search(100), range_search(100.1), "at most 10,000 timesteps"),
        (mjcf('<size nuser_geom="100"/>'), mjcf('<size nuser_geom="101"/>'), "at most 100"),
    ],
)
def test_the_largest_that_is_allowed_is_not_refused(largest, larger, said):
    checked(largest)
    with pytest.raises(TrackslipError, match=said):
        checked(larger)


COUNTS = [
    (tag, name, most) for tag, counts in MAX_COUNTS.items() for name, most in counts.items()
] + [("motor", name, most) for name, most in MAX_COUNTS_ANYWHERE.items()]


@pytest.mark.parametrize(("tag", "name", "most"), COUNTS)
def test_counts_are_allowed_up_to_their_limits(tag, name, most):
    checked(mjcf(f'<{tag} type="2d" {name}="{most}"/>'))  # a cube's texture is six times as high
    said = f"<{tag}> {name} = '{most + 1}': must be at most {most:,}"
    with pytest.raises(TrackslipError, match=said):
        checked(mjcf(f'<{tag} type="2d" {name}="{most + 1}"/>'))


@pytest.mark.parametrize("value", ["inf", "-inf", "nan", "Infinity", "nan(1)", "1e308", "0x1p99"])
def test_numbers_of_models_are_finite(build, value):
    for text, name in (
        (mjcf("", f'<body pos="0 {value} 0"/>'), "robot.xml"),
        (URDF.format(f'<collision><origin xyz="0 0 {value}"/></collision>', ""), "robot.urdf"),
    ):
        with pytest.raises(TrackslipError, match=r"m/robot\.\w+: <\w+> \w+ = .*must be finite"):
            build(text, name)


@pytest.mark.parametrize("limit", ["1e16", "1.79769e+308"])
def test_joints_without_end_may_have_huge_limits(build, limit):
    joint = f"""<link name="wheel">{INERTIAL}</link><joint name="j" type="revolute">
      <parent link="base"/><child link="wheel"/><axis xyz="0 1 0"/>
      <limit lower="-{limit}" upper="{limit}" effort="{limit}" velocity="{limit}"/></joint>"""
    text = URDF.format("", joint)
    assert build(text, "robot.urdf", 'wheels = ["wheel"]\n').nv == 6


@pytest.mark.parametrize(
    "text",
    [
        '<!DOCTYPE r [<!ENTITY a "b">]>' + mjcf(),
        "<!DOCTYPE r [<!ELEMENT r (a)> " + mjcf() + " ]>" + mjcf(),
        mjcf("<![CDATA[ <!-- ]]>"),
        mjcf("<?a b?>"),
    ],
)
def test_what_parsers_read_differently_is_refused(build, text):
    with pytest.raises(TrackslipError, match="line 1: DOCTYPE, CDATA and processing instructions"):
        build(text)


@pytest.mark.parametrize(
    "text",
    [mjcf()[:-3], mjcf() * 2, mjcf('<a b="<!--"/><c d="-->"/>'), mjcf("<size/ >"), "<mujoco"],
)
def test_text_that_is_no_xml_is_refused(build, text):
    with pytest.raises(TrackslipError, match=r"robot\.xml: not XML \(.*line 1"):
        build(text)


def test_comments_may_contain_what_xml_forbids(build):
    assert build(mjcf("<!-- -- wheels -- \n & %s -->")).nbody > 1


def test_huge_texts_are_refused_unread(build, tmp_path):
    with pytest.raises(TrackslipError, match=r"robot\.xml: 32,000,\d+ bytes long, must be at most"):
        build(mjcf() + " " * MAX_TEXT)


OUTSIDE = "must lie in the model's folder, in its ROS package or in a folder that the robot file"


@pytest.mark.parametrize("file", ["../../outside.xml", "/etc/hostname", "a/../../../outside.xml"])
@pytest.mark.parametrize(
    "text",
    [
        mjcf('<include file="{}"/>'),
        asset('<texture name="t" type="2d" file="{}"/>'),
        asset('<texture name="t" type="cube" fileright="{}"/>'),
        asset('<hfield name="h" size="1 1 1 1" file="{}"/>'),
        asset('<model name="a" file="{}"/>'),
        asset('<skin name="a" file="{}"/>'),
        mjcf("", '<flexcomp name="f" type="mesh" file="{}"/>'),
    ],
)
def test_files_outside_of_the_models_folders_are_refused(build, tmp_path, text, file):
    with pytest.raises(TrackslipError, match=OUTSIDE):
        build(text.replace("{}", file))


@pytest.mark.parametrize("kind", ["mjcf", "urdf"])
def test_meshes_outside_of_the_models_folders_are_refused(build, tmp_path, kind):
    (tmp_path.parent / "outside.obj").write_text(CUBE)
    for file in ("../../outside.obj", str(tmp_path.parent / "outside.obj")):
        text = mjcf(f"<asset>{MESH[0].format(file)}</asset>", MESH[1])
        name = "robot.xml"
        if kind == "urdf":
            shape = f'<collision><geometry><mesh filename="{file}"/></geometry></collision>'
            text = URDF.format(shape, "")
            name = "robot.urdf"
        with pytest.raises(
            TrackslipError, match=r"needs .*outside\.obj to collide .* lists in `pa"
        ):
            build(text, name)
        assert build(text, name, 'packages = [".."]\n').nmesh == 1


@pytest.mark.parametrize(
    "uri", ["package://m/../../outside.obj", "package:///{}", "package://../{}"]
)
def test_package_uris_stay_in_their_package(build, tmp_path, uri):
    (tmp_path.parent / "outside.obj").write_text(CUBE)
    file = uri.format(str(tmp_path.parent / "outside.obj").lstrip("/"))
    shape = f'<collision><geometry><mesh filename="{file}"/></geometry></collision>'
    with pytest.raises(TrackslipError, match="needs package://"):
        build(URDF.format(shape, ""), "robot.urdf")


def test_meshes_beside_the_file_and_in_the_package_are_read(build, tmp_path):
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "a.obj").write_text(CUBE)
    text = mjcf(f"<asset>{MESH[0].format('../meshes/a.obj')}</asset>", MESH[1])
    assert build(text).nmesh == 1
    (tmp_path / "package.xml").write_text("<package><name>m</name></package>")
    assert build(text).nmesh == 1


def test_links_to_files_elsewhere_are_followed(build, tmp_path):
    (tmp_path.parent / "linked.obj").write_text(CUBE)
    (tmp_path / "m" / "a.obj").symlink_to(tmp_path.parent / "linked.obj")
    assert build(mjcf(f"<asset>{MESH[0].format('a.obj')}</asset>", MESH[1])).nmesh == 1


@pytest.mark.parametrize(
    "text",
    [
        mjcf('<include file="pipe"/>'),
        asset('<texture name="t" type="2d" file="pipe"/>'),
        asset('<hfield name="h" size="1 1 1 1" file="pipe"/>'),
        asset('<model name="a" file="pipe"/>'),
        mjcf("<asset>" + MESH[0].format("pipe.obj") + "</asset>", MESH[1]),
    ],
)
def test_pipes_are_refused_unopened(build, tmp_path, text):
    for name in ("pipe", "pipe.obj"):
        os.mkfifo(tmp_path / "m" / name)
    with pytest.raises(TrackslipError, match=r"pipe: not a regular file|there is no .*pipe\.obj"):
        build(text)


def test_a_pipe_as_model_is_refused_unopened(build, tmp_path):
    os.mkfifo(tmp_path / "m" / "pipe.xml")
    (tmp_path / "robot.toml").write_text(ROBOT.format("pipe.xml"))
    with pytest.raises(TrackslipError, match=r"pipe\.xml: not a regular file"):
        load_tracked(tmp_path / "robot.toml").spec()


@pytest.mark.parametrize(
    ("main", "other", "said"),
    [
        ('<include file="robot.xml"/>', "", "included twice"),
        ('<include file="a.xml"/>', '<include file="robot.xml"/>', "included twice"),
        ('<include file="a.xml"/><include file="./a.xml"/>', "", "included twice"),
        ('<include file="gone.xml"/>', "", "file = 'gone.xml': no such file"),
        ('<include file="a.xml"/>', '<size nkey="100000"/>', "nkey = '100000'"),
        ('<include file="a.xml"/>', '<default><default class="%p"/></default>', "free of %"),
        ('<asset><model name="a" file="robot.xml"/></asset>', "", "attaches itself"),
        (
            '<asset><model name="a" file="a.xml"/></asset>',
            '<asset><model name="a" file="robot.xml"/></asset>',
            "attaches itself",
        ),
        (
            '<asset><model name="a" file="a.xml"/></asset>',
            '<default><default class="%p"/></default>',
            r"a\.xml: <default> class = '%p'",
        ),
    ],
)
def test_what_a_model_includes_or_attaches_is_checked(build, tmp_path, main, other, said):
    (tmp_path / "m" / "a.xml").write_text(f"<mujoco>{other}</mujoco>")
    with pytest.raises(TrackslipError, match=said):
        build(mjcf(main))


def test_attached_models_count_as_often_as_they_are_attached(build, tmp_path):
    """Thirty files, each of which attaches the next one twice."""
    for k in range(30):
        models = "".join(f'<model name="{name}" file="{k + 1}.xml"/>' for name in "ab")
        (tmp_path / "m" / f"{k}.xml").write_text(f"<mujoco><asset>{models}</asset></mujoco>")
    (tmp_path / "m" / "30.xml").write_text("<mujoco/>")
    with pytest.raises(TrackslipError, match="elements, repeated and attached ones included"):
        build(asset('<model name="a" file="0.xml"/>'))


def test_includes_are_built_as_before(build, tmp_path):
    (tmp_path / "m" / "parts").mkdir()
    (tmp_path / "m" / "parts" / "a.xml").write_text('<mujoco><include file="b.xml"/></mujoco>')
    (tmp_path / "m" / "parts" / "b.xml").write_text('<a><body name="mast"/></a>')
    assert build(mjcf("", '<include file="parts/a.xml"/>')).body("mast").id > 0


def picture(rows, columns):
    """The header of a .png, which claims a size."""
    return b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + struct.pack(">II", columns, rows)


@pytest.mark.parametrize(
    ("text", "content", "said"),
    [
        (
            asset('<texture name="t" type="2d" file="a"/>'),
            picture(20_000, 20_000),
            "400,000,000 p",
        ),
        (
            asset('<hfield name="h" size="1 1 1 1" file="a"/>'),
            picture(3000, 3000),
            "9,000,000 sam",
        ),
        (
            asset('<hfield name="h" size="1 1 1 1" file="a"/>'),
            b"\0" * 20_000_000,
            "5,000,000 sam",
        ),
        (mjcf("", '<flexcomp name="f" type="mesh" file="a"/>'), b"v 0 0 0\n" * 3000, "24,000 byte"),
        (asset('<skin name="h" file="a"/>'), b"\0" * (MAX_FILE + 1), "64,000,001 bytes long"),
    ],
)
def test_files_are_measured_before_they_are_read(build, tmp_path, text, content, said):
    (tmp_path / "m" / "a").write_bytes(content)
    with pytest.raises(TrackslipError, match=said):
        build(text)


@pytest.mark.parametrize("faces", [0, 11, 13, 2**31, 2**32 - 1])
def test_an_stl_with_a_false_number_of_faces_is_refused(build, tmp_path, faces):
    header = b"\0" * 80
    face = struct.pack("<12fH", *[0.5] * 12, 0)
    content = header + struct.pack("<I", faces) + face * 12
    (tmp_path / "m" / "a.stl").write_bytes(content)
    with pytest.raises(TrackslipError, match=r"doesn't read such an \.stl \(ASCII, damaged, or"):
        build(mjcf(f"<asset>{MESH[0].format('a.stl')}</asset>", MESH[1]))


def test_large_meshes_are_refused_unread(build, tmp_path):
    with (tmp_path / "m" / "a.obj").open("wb") as file:
        file.truncate(MAX_FILE + 1)
    with pytest.raises(TrackslipError, match=r"a\.obj: 64,000,001 bytes long"):
        build(mjcf(f"<asset>{MESH[0].format('a.obj')}</asset>", MESH[1]))


def test_meshes_are_bounded_all_together(tmp_path):
    """Four of the largest, and no byte more."""
    sizes = MeshSizes()
    for k in range(4):
        with (tmp_path / f"{k}.obj").open("wb") as file:
            file.truncate(MAX_FILE)
        sizes.add(tmp_path / f"{k}.obj")
    assert sizes.total == 256_000_000
    (tmp_path / "more.obj").write_bytes(b"#")
    said = r"more\.obj: with it, mesh files have 256,000,001 bytes, must be at most 256,000,000"
    with pytest.raises(TrackslipError, match=said):
        sizes.add(tmp_path / "more.obj")


def test_an_engine_out_of_memory_is_one_line_with_the_model(build, tmp_path):
    arms = '<body><joint axis="0 1 0"/><geom size="1" mass="1"/></body>'
    crowd = f'<replicate count="150" offset="0 0 0.001">{arms}</replicate>'
    text = mjcf('<size memory="1M"/>', crowd)
    with pytest.raises(TrackslipError, match=r"m/robot\.xml: .*out of memory") as refused:
        build(text)
    assert "\n" not in str(refused.value)
