"""Controllers, references and compensations that options name, listed so that `--help` need not import them."""

CONTROLLER_NAMES = (
    *("feedforward", "linear", "samson", "kanayama", "dynamic_feedback", "offset_point"),
    *("pure_pursuit", "regulated_pure_pursuit", "stanley", "path_following", "lqr", "ltv_mpc", "mpc", "mppi"),
)
"""The controllers of trackslip.controllers."""
REFERENCE_NAMES = ("paper", "circle", "figure_eight", "slalom", "rounded_square", "clothoid", "spiral", "stop_and_go")
"""The references of trackslip.trajectory."""
TRAINING_PATHS = ("circle", "slalom", "clothoid", "stop_and_go")
"""References for tuning and training; the suite `fair` has the others."""
GROUND_NAMES = (
    *("stone", "concrete", "rubber", "packed_soil", "gravel", "wet", "sticky"),
    *("firm_sand", "loose_sand", "clay", "snow", "asphalt", "grass", "ice"),
)
"""The grounds of sim.ground."""
ROBOT_NAMES = (SHIPPED := "shipped", "rescue", "box", "husky", "warthog", "maxxii")
"""The robots of sim.robot."""
FTR_NAMES = tuple(
    f"{kind}{size}"
    for size in ("", "_published")
    for kind in (
        *("steps_up", "steps_down", "uplifts", "one_sided", "plum_piles"),
        *("waves", "rails", "stairs_up", "stairs_down", "mixed"),
    )
)
"""The courses of sim.traverse.courses."""
WITHOUT_LAWS = ("none", "published", "online_cold")
"""Compensations that need no identified law."""
CONTROLLERS = f"{{{','.join(CONTROLLER_NAMES)},ppo:FOLDER,MODULE:CLASS}}"
REFERENCES = f"{{{','.join(REFERENCE_NAMES)},FILE.csv}}"
COMPENSATIONS = "{none,published,LAW,online,online_load,online_cold}"
ROBOTS = f"{{{','.join(ROBOT_NAMES)},FILE.toml}}"
GROUNDS = f"{{{','.join(GROUND_NAMES)},FILE.toml}}"
"""Placeholders of option values in `--help`."""
