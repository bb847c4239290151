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
    ),
    "identify": (
        ("from a stored grid", "trackslip identify out/grid"),
        ("from a real robot's log", "trackslip identify log.csv --half-gauge 0.168 --sprocket-radius 0.06"),
        ("as the paper did", "trackslip identify out/grid --motion paper --out out/identify-paper"),
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
        ("four million steps", "trackslip train"),
        ("go on from the last checkpoint", "trackslip train --steps 8000000 --resume"),
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
