"""Soils by name, with the sources of their values, which are quoted second-hand.

Wong: J. Y. Wong, Theory of Ground Vehicles (2008), table of pressure-sinkage and shear strength;
Chrono: the soils in the demonstrations of Project Chrono's deformable terrain. The growth n1 of the
exponent is assumed for all soils: 0.4 is between 0.35 and 0.45, which are in use for simulants of
planetary soil with the same equation (Ding et al. 2010). The unit weights are assumed, too.
"""

import math
from typing import Final

from trackslip.skid_theory.soil import Soil

_SLIP_SINKAGE: Final = 0.4  # n1 [-]
_SAND: Final = 15e3  # unit weight [N/m^3]
_SNOW: Final = 3e3  # unit weight [N/m^3]
_ALWAYS_ASSUMED: Final = ("n1", "unit_weight")


def _tabulated(
    k_c: float,
    k_phi: float,
    n: float,
    cohesion: float,
    angle: float,
    shear: float,
    source: str,
    unit_weight: float = _SAND,
    assumed: tuple[str, ...] = (),
) -> Soil:
    """A soil in the units of the tables: moduli with kN, cohesion in kPa, angle in degrees, shear
    modulus in mm.
    """
    return Soil(
        k_c=1e3 * k_c,
        k_phi=1e3 * k_phi,
        n=n,
        n1=_SLIP_SINKAGE,
        cohesion=1e3 * cohesion,
        friction_angle=math.radians(angle),
        shear=1e-3 * shear,
        unit_weight=unit_weight,
        source=source,
        assumed=(*assumed, *_ALWAYS_ASSUMED),
    )


NAMED_SOILS: Final[dict[str, Soil]] = {
    "dry_sand": _tabulated(
        0.99, 1528, 1.1, 1.04, 28.0, 25.0, "Wong, Land Locomotion Laboratory", assumed=("shear",)
    ),
    "lete_sand": _tabulated(102, 5301, 0.793, 1.3, 31.1, 12.0, "Wong; Chrono's rigid tyre"),
    "upland_loam": _tabulated(
        74.6, 2080, 1.1, 3.3, 33.7, 20.0, "Wong, upland sandy loam", assumed=("shear",)
    ),
    "soft_snow": _tabulated(
        4.37, 197, 1.6, 1.03, 19.7, 40.0, "Wong, snow (U.S.)", _SNOW, assumed=("shear",)
    ),
    "regolith": _tabulated(1.4, 820, 1.0, 0.17, 35.0, 17.8, "Chrono's Curiosity"),
}
"""Soils by name."""
