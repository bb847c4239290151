"""What commands refuse beyond bounds and exclusions: one line, exit code 2, and nothing is written."""

import shlex

import pytest

PLAN = "plan --half-gauge 0.168 --sprocket-radius 0.06"
DRAG = "track --controller feedforward"

OPTIONS = [
    ("paint", "COMMAND = 'paint': must be one of bag, bench, benchmark, calibrate, "),
    ("grid --out ''", "--out = '': must be non-empty"),
    ("grid --out=", "--out = '': must be non-empty"),
    ("grid --out \udcff", "--out = '\\udcff': must be valid UTF-8"),
    ("grid --radii 1 --radii 2", "--radii is given twice; give it once, with all its values"),
    ("grid --random-phase --no-random_phase", "--no-random-phase is given twice"),
    ("grid --radii 0.5 0.168", "radii = 0.168: must be greater than the half gauge, 0.168 m"),
    ("grid --speeds 0.5", "speeds = 0.5: must be at most drive.top_speed = 0.3 m/s"),
    ("grid --scanner.rate 33", "scanner.rate = 33.0: must be a rate whose period is a multiple of drive.period"),
    ("reproduce --drive.period 0.0025", "drive.period = 0.0025: must be a multiple of the physics step"),
    ("track --reference circle --circle-speed 1e-9", "circle_speed = 1e-09: must be at least 0.001 m/s"),
    ("track --controller pid", "controller = 'pid': must be one of feedforward"),
    ("track --laws nowhere.json", "nowhere.json: No such file"),
    ("identify nowhere.csv", "nowhere.csv: no such file"),
    (f"identify {'x' * 300}", "path = 'xxx"),
    # grounds, robots, motors, what is towed, obstacles: options of groups are named with the group
    ("grid --ground mud", "ground = 'mud': must be one of stone, concrete"),
    (f"grid --ground {'x' * 5000}", "ground = 'xxx"),
    ("grid --ground.across 0", "ground.across = 0.0: must be a finite number > 0"),
    ("grid --ground.slope 0.9", "slope = 0.9: must be less than the friction angle"),
    (
        "grid --radii 1 --speeds 0.1 --ground.slope 0.9 --ground.along 10 --ground.across 10",
        "to park with heading 0 rad: the robot tips",
    ),
    ("grid --drive.motor.gear 1e-300", "drive.motor.gear = 1e-300: must be at least 1e-12"),
    ("grid --obstacles forest", "obstacles = 'forest': must be one of posts"),
    ("grid --scanner.scan-duration 0.06", "scanner.scan_duration = 0.06: must be at most 0.05 s"),
    (f"{DRAG} --pull -1", "force = -1.0"),
    (f"{DRAG} --ground clay --pull 300", "not to drag the robot backwards from rest"),
    (f"{DRAG} --pull 160 --pull.height 0.6", "tips over"),
    # predictions from theory
    ("predict --com-x 0.2", "com_x = 0.2: must be between"),
    ("predict --friction-ratio 1e-300", "friction_ratio = 1e-300: must be at least 0.01"),
    ("predict --slope 0.9", "less than the friction limit"),
    ("predict --friction 0.5", "friction = 0.5: must be left out without --slope and --pull"),
    # teleoperated drives
    ("wander --duration 0.03", "duration = 0.03: must be at least 0.04 s, two readings"),
    ("wander --max-speed 0.4", "max_speed = 0.4: must be at most drive.top_speed = 0.3 m/s"),
    ("wander --encoder-rate 30", "encoder_rate = 30.0: must be a rate whose period is a multiple of drive.period"),
    ("wander --law.offset 0.1", "law.offset = 0.1: must be left out without --motion law"),
    ("wander --motion law --ground ice", "ground = 'ice': must be left out with --motion law"),
    # training and calibration
    ("train --env maze", "env = 'maze': must be one of path_tracking, traverse"),
    ("train --batch 1000", "batch = 1000: must be a factor of robots * horizon = 8192"),
    ("train --network 1000000000", "network = 1000000000: must be an integer from 1 to 4096"),
    ("calibrate --target nowhere.csv", "nowhere.csv: no such file"),
    # experiments to plan
    ("plan", "half_gauge = None: must be given (--half-gauge on the command line)"),
    ("plan --half-gauge 0.2", "sprocket_radius = None: must be given (--sprocket-radius on the command line)"),
    (f"{PLAN} --area 3x-3", "area = '3x-3': must be length x width in metres, such as 3x3 or 4.5x2"),
    (f"{PLAN} --area 0.6x3", "area = '0.6x3': must be more than 0.672 m long and wide, for the robot to turn"),
    ("plan --after nowhere", "nowhere: No such file or directory"),
]
FILES = [
    ("--ground", "along = [", "not TOML"),
    ("--ground", "slope = 0.9", "slope = 0.9: must be less than the friction angle, 0.611 rad"),
    ("--ground", '"two\\nlines" = 1', "two lines is unknown"),
    ("--robot", "half_gauge = 0.01", "com_height = 0.12: must be at most 0.0125 m, to stand on tracks"),
    ("--robot", "[ground]\nbase = 'ice'", "ground: base is unknown"),
]
REJECTED = [
    ("", "Expected one of {bag, bench,"),
    ("grid --colour red", "Unrecognized options: --colour"),
    ("coverage --motion arc", "--motion (applied to trackslip coverage)"),
    ("grid --seed 1.5", "Error parsing --seed"),
    ("grid --seed", "Missing value for argument '--seed'"),
    ("grid --radii 1 ½", "Error parsing --radii"),
    ("grid --motion None", "Error parsing --motion"),
    ("track --start 1 2", "Error parsing --start"),
    ("track --localization eye", "invalid choice 'eye' for argument '--localization'"),
    ("calibrate --free mass", "invalid choice 'mass'"),
    ("identify", "PATH"),
    (f"{PLAN} --poses sonar", "invalid choice 'sonar' for argument '--poses'"),
    ("--tyro-print-completion", "Unrecognized options: --tyro-print-completion"),
]


@pytest.mark.parametrize(("line", "message"), OPTIONS)
def test_a_refused_value_prints_one_line(refused, line, message):
    assert message in refused(*shlex.split(line))


@pytest.mark.parametrize(("option", "text", "message"), FILES)
def test_a_file_with_a_mistake_prints_one_line(refused, tmp_path, option, text, message):
    (tmp_path / "odd.toml").write_text(text)
    assert message in refused("grid", option, "odd.toml")


@pytest.mark.parametrize(("line", "message"), REJECTED)
def test_tyro_explains_what_it_rejects(rejected, line, message):
    assert message in rejected(*shlex.split(line))
