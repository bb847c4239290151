"""Examples of every command, as `--help` prints them."""

from __future__ import annotations

EXAMPLES: dict[str, tuple[tuple[str, str], ...]] = {
    "": (
        ("the whole paper, with a report in out/reproduce/report.html", "trackslip reproduce"),
        ("a command's options and examples", "trackslip grid --help"),
        ("completion by Tab in this shell", 'eval "$(trackslip completion bash)"'),
    ),
    "grid": (
        ("the paper's 25 runs", "trackslip grid"),
        ("six runs of 20 s", "trackslip grid --radii 0.5 1 2 --speeds 0.1 0.2 --duration 20"),
        ("on a slope of gravel", "trackslip grid --ground gravel --ground.slope 0.1 --ground.uphill 1.57"),
        ("with a worse scanner", "trackslip grid --scanner.noise 0.01 --obstacles posts --out out/noisy"),
        ("a thousand runs", "trackslip grid --grounds stone ice --slope 0 0.05 --seeds 0 1 2 3 4 5 6 7 8 9"),
        ("over any option", "trackslip grid --vary scanner.noise=0.005,0.02 robot.half_gauge=0.15,0.2"),
        ("on a Dask cluster", "trackslip grid --sweep sweep.toml --executor dask://host:8786"),
    ),
    "identify": (
        ("from a stored grid", "trackslip identify out/grid"),
        ("from a real robot's log", "trackslip identify log.csv --half-gauge 0.168 --sprocket-radius 0.06"),
        ("from some of a sweep's runs", "trackslip identify out/grid --where ground=ice seed=0"),
        ("as the paper did", "trackslip identify out/grid --motion paper --out out/identify-paper"),
    ),
    "export": (
        ("the names of the runs", "trackslip export out/grid"),
        ("all of them as CSV", "trackslip export out/grid --csv"),
        ("one of them", 'trackslip export out/grid --csv --run "radius=0.5 speed=0.1" --out run.csv'),
    ),
    "view": (
        ("the first run", "trackslip view out/track"),
        ("two runs, compared", 'trackslip view out/reproduce --run "linear none" --run "linear icr"'),
        ("a file for the viewer", "trackslip view log.csv --save log.rrd"),
    ),
    "track": (
        ("the paper's path and controller", "trackslip track"),
        ("without compensation of slip", "trackslip track --compensation none --out out/track-none"),
        ("slip found while driving", "trackslip track --controller lqr --compensation online --reference slalom"),
        ("with laws of your own", "trackslip track --laws out/identify --compensation exponential"),
    ),
    "benchmark": (
        ("every controller on the paper's path", "trackslip benchmark"),
        ("Sec. IV of the paper", "trackslip benchmark --suite paper"),
        ("two controllers on ice", "trackslip benchmark --controllers linear lqr --grounds ice --seeds 0 1"),
        ("one of your own", "trackslip benchmark --controllers linear my_controller:MyController"),
    ),
    "train": (
        ("two million steps", "trackslip train"),
        ("go on from the last checkpoint", "trackslip train --steps 4000000 --resume"),
        ("a quick try", "trackslip train --steps 100000 --robots 16 --batch 512 --out out/try"),
    ),
    "predict": (
        ("the shipped robot", "trackslip predict"),
        ("one of other size", "trackslip predict --half-gauge 0.25 --contact-length 0.6 --friction-ratio 1.2"),
    ),
    "calibrate": (
        ("to the paper's slips and radii", "trackslip calibrate"),
        ("to a log, with other parameters", "trackslip calibrate --target log.csv --free friction_ratio radius_error"),
    ),
    "validate": (
        ("the shipped robot", "trackslip validate"),
        ("a calibrated one", "trackslip validate --robot out/calibrate/robot.toml"),
    ),
    "coverage": (
        ("a thousand repeats", "trackslip coverage"),
        ("fewer", "trackslip coverage --repeats 100 --run-repeats 40 --drives 4"),
    ),
    "sensitivity": (
        ("the paper's grid", "trackslip sensitivity"),
        ("a smaller one", "trackslip sensitivity --radii 0.5 1.5 --speeds 0.1 0.2 --duration 20"),
    ),
    "reproduce": (
        ("the paper", "trackslip reproduce"),
        ("with other random numbers", "trackslip reproduce --seed 1 --out out/reproduce-1"),
        ("on other ground", "trackslip reproduce --ground.across 0.9 --scanner.noise 0.01"),
    ),
    "bench": (
        ("the simulator", "trackslip bench"),
        ("a quick look", "trackslip bench --sizes 1 64 --thread-counts 1 --seconds 5 --repeats 3"),
        ("the learning environments", "trackslip bench --env"),
        ("a thousand runs, on one process and on two", "trackslip bench --grid"),
    ),
    "completion": (
        ("in this shell", 'eval "$(trackslip completion bash)"'),
        ("in every fish", "trackslip completion fish > ~/.config/fish/completions/trackslip.fish"),
    ),
}
"""What each command line does, and the line, by command; those of trackslip itself under the empty name."""


def examples_text(command: str) -> str:
    """The end of a command's help; empty where there are no examples."""
    lines = [f"  {line}\n      {what}" for what, line in EXAMPLES.get(command, ())]
    return "\n".join(["examples:", *lines]) if lines else ""
