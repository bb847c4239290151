"""Names that options accept, listed here so that `--help` need not import the modules behind
them.
"""

from typing import Final

CONTROLLER_NAMES: Final = (
    *("feedforward", "linear", "samson", "kanayama", "dynamic_feedback", "offset_point"),
    *(
        "pure_pursuit",
        "regulated_pure_pursuit",
        "stanley",
        "path_following",
        "lqr",
        "ltv_mpc",
        "mpc",
        "mppi",
    ),
)
"""Names of the controllers in trackslip.controllers."""
REFERENCE_NAMES: Final = (
    "paper",
    "circle",
    "figure_eight",
    "slalom",
    "rounded_square",
    "clothoid",
    "spiral",
    "stop_and_go",
)
"""Names of the references in trackslip.trajectory."""
TRAINING_PATHS: Final = ("circle", "slalom", "clothoid", "stop_and_go")
"""References for tuning and training; the `fair` suite tests controllers on the other
references.
"""
GROUND_NAMES: Final = (
    *("stone", "concrete", "rubber", "packed_soil", "gravel", "wet", "sticky"),
    *("firm_sand", "loose_sand", "clay", "snow", "asphalt", "grass", "ice"),
    *("dry_sand", "lete_sand", "upland_loam", "soft_snow", "regolith"),
)
"""Names of the grounds in sim.ground."""
ROBOT_NAMES: Final = (SHIPPED := "shipped", "rescue", "box", "husky", "warthog", "maxxii")
"""Names of the robots in sim.robot."""
FTR_NAMES: Final = tuple(
    f"{kind}{size}"
    for size in ("", "_published")
    for kind in (
        *("steps_up", "steps_down", "uplifts", "one_sided", "plum_piles"),
        *("waves", "rails", "stairs_up", "stairs_down", "mixed"),
    )
)
"""Names of the courses in sim.traverse.courses."""
WITHOUT_LAWS: Final = ("none", "published", "online_cold")
"""Compensations that need no identified law."""
CONTROLLERS: Final = f"{{{','.join(CONTROLLER_NAMES)},ppo:FOLDER,MODULE:CLASS}}"
REFERENCES: Final = f"{{{','.join(REFERENCE_NAMES)},FILE.csv}}"
COMPENSATIONS: Final = "{none,published,LAW,online,online_load,online_cold}"
ROBOTS: Final = f"{{{','.join(ROBOT_NAMES)},FILE.toml}}"
GROUNDS: Final = f"{{{','.join(GROUND_NAMES)},FILE.toml}}"
"""Placeholders for option values in `--help`."""
