import shlex

import pytest

PLAN = "plan --half-gauge 0.168 --sprocket-radius 0.06"
DRAG = "track --controller feedforward"
ROBOT = "--half-gauge 0.168 --sprocket-radius 0.06"

OPTIONS = [
    ("paint", "COMMAND = 'paint': must be one of "),
    ("export --out x", "export is gone; use: "),
    ("grid --radii 1/2", "Error parsing --radii"),
    (f"{PLAN} --poses sonar", "invalid choice 'sonar' for argument '--poses'"),
    ("grid --radii 0.5 0.168", "radii = 0.168: must be greater than the half gauge, 0.168 m"),
    ("grid --speeds 0.5", "speeds = 0.5: must be at most drive.top_speed = 0.3 m/s"),
    (
        "grid --scanner.rate 33",
        "scanner.rate = 33.0: must be a rate whose period is a multiple of drive.period",
    ),
    (  # too noisy for twists of three of its four runs
        "reproduce --radii 0.5 1.5 --speeds 0.1 0.2 --duration 10 --localization line --motion "
        "paper --obstacles room",
        "law icr_radius: 1 sample of two tracks can't determine its 2 parameters",
    ),
    ("tune linear --compensations wax", "compensations = 'wax': must be one of none"),
    (
        "benchmark --gains nowhere",
        "gains = 'nowhere': must be tuned, default, or a folder or file that trackslip tune",
    ),
    ("benchmark --controllers linear:stiffness=stiff", "stiffness = 'stiff': must be a number"),
    (
        "benchmark --controllers linear:g=1",
        "must be linear:ARGUMENT=VALUE,... with different arguments among damping",
    ),
    ("track --laws nowhere.json", "nowhere.json: No such file"),
    (f"identify {'x' * 300}", "path = 'xxx"),
    ("deploy --law online", "law = 'online': must be one of none, "),
    (
        "deploy --controller my-robot",
        "controller = 'my-robot': must be a name of letters, digits and _",
    ),
    # grounds, robots, motors, what is towed, obstacles: options of groups are named with the group
    (
        "grid --radii 1 --speeds 0.1 --ground.slope 0.9 --ground.along 10 --ground.across 10 "
        "--drive.torque-limit 90 "
        "--drive.motor.stall-torque 2",
        "to park with heading 0 rad: the robot tips",
    ),
    (f"{DRAG} --ground clay --pull 300", "pull = 300.0: must be less, to park"),
    (f"{DRAG} --pull 160 --pull.height 0.6", "tips over"),
    (f"{DRAG} --pull -1", "pull = -1.0: must be a finite number >= 0"),
    # predictions from theory
    ("predict --slope 0.9", "less than the friction limit"),
    # drives by people, over courses, and planned
    ("wander --max-speed 0.4", "max_speed = 0.4: must be at most drive.top_speed = 0.3 m/s"),
    (
        "train --env traverse --courses rails moon",
        "courses = 'moon': must be some of random, steps_up",
    ),
    ("drive --flippers sideways", "flippers = 'sideways': must be up, down, reflex, or angles"),
    ("plan", "half_gauge = None: must be given (--half-gauge on the command line)"),
    (f"{PLAN} --area 3x", "area = '3x': must be length x width in metres, such as 3x3 or 4.5x2"),
    (
        f"{PLAN} --topic 'cmd vel'",
        "topic = 'cmd vel': must be names of letters, digits and _, joined by /",
    ),
    # numbers far too large
    ("train --horizon 1000000000", "horizon = 1000000000: must be an integer from 1 to 100000"),
    (
        "train --robots 4096 --horizon 100000 --batch 4096",
        "horizon = 100000: must be at most 976 for 4096 robots",
    ),
    ("train --epochs 1000000000", "epochs = 1000000000: must be an integer from 1 to 1000"),
    # sweeps
    ("grid --vary noise", "vary = 'noise': must be NAME=VALUE,VALUE,..."),
    (
        "grid --radii 1 --vary radius=2,3",
        "radii = (1.0,): must be left out where radius is an axis",
    ),
    (
        "grid --radii 0.5 0.15 --vary robot.half_gauge=0.2,0.3",
        "radii = 0.15: must be greater than the half gauge, 0.2",
    ),
    ("grid --vary friction_ratio=1,1", "friction_ratio = (1.0, 1.0): must be all different"),
    ("grid --vary scanner.noise=0.1,loud", "Error parsing --scanner.noise"),
    # learning and benchmarks
    (
        "benchmark --controllers lqr linear:",
        "controllers = 'linear:': must be linear:ARGUMENT=VALUE,...",
    ),
    ("benchmark --controllers policy.npz", "mppi, ppo:FOLDER or MODULE:CLASS"),
    ("benchmark --controllers none:Mine", "controllers = 'none:Mine': must be MODULE:CLASS that"),
    ("benchmark --radius-error 0.49", "radius_error of drawn plants = "),
]
GAINS = (
    '{"gains": [{"controller": "linear", "compensation": "none", "arguments": {"weight": 1.0}}]}'
)
TRACE = "run,t,omega_l,omega_r,x,y,phi\n" + "".join(
    f"a,{k / 20},2,3,{k / 100},0,0\n" for k in range(200)
)
SAMPLES = "omega_l,omega_r,v,w\n2,3,0.15,0.1\n3,2,0.15,-0.1"
FILES = [
    (
        "grid --robot {}",
        "odd.toml",
        "half_gauge = 0.01",
        "com_height = 0.12: must be at most 0.0125 m, to stand on",
    ),
    (
        f"identify {ROBOT} {{}}",
        "log.csv",
        TRACE.replace(",0,0\n", ",oops,0\n"),
        "row 1, column y: 'oops' is not a",
    ),
    (f"identify {ROBOT} {{}} --plate 0.6x0.04", "log.csv", TRACE, "is no bag"),
    (
        f"identify {ROBOT} {{}} --encoders /a",
        "log.csv",
        TRACE,
        "encoders = '/a': must be left out: ",
    ),
    (
        f"identify {ROBOT} {{}} --where a=1",
        "log.csv",
        TRACE,
        "log.csv: holds no runs of a sweep: --where must be left",
    ),
    ("calibrate --target {} --folds 7", "samples.csv", SAMPLES, "folds = 7"),
    (
        "calibrate --target {} --free radius_error radius_left --test none.csv",
        "samples.csv",
        SAMPLES,
        "none.csv: no",
    ),
    (
        "benchmark --controllers linear --compensations none --gains {}",
        "gains.json",
        GAINS,
        "weight",
    ),
    ("track --laws {}", "laws.json", "[" * 100_000, "laws.json"),
    ("deploy {}", "laws.json", '{"slip_laws": {"icr"', "not JSON"),
]


@pytest.mark.parametrize(("line", "message"), OPTIONS)
def test_a_value_is_refused(failing, line, message):
    assert message in " ".join(failing(*shlex.split(line)).replace("│", " ").split())


@pytest.mark.parametrize(("line", "name", "text", "message"), FILES)
def test_a_file_with_a_mistake_prints_one_line(refused, tmp_path, line, name, text, message):
    (tmp_path / name).write_text(text)
    assert message in refused(*shlex.split(line.format(name)))
