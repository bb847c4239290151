"""`trackslip predict`: a slip law from theory, without simulating."""

from __future__ import annotations

import time

import numpy as np

from experiments import store
from experiments.config import PredictConfig
from experiments.console import print_table
from trackslip.skid_theory import line_contact, steady_twist
from trackslip.slip import ConstantIcr


def run(config: PredictConfig) -> None:
    """Compute the law, store and print it."""
    began = time.perf_counter()
    law = predict(config)
    slip = law(1 / np.array(config.radii))
    with store.results(config.out) as folder:
        wall = time.perf_counter() - began
        summary = {
            "geometry": {"half_gauge": config.half_gauge, "sprocket_radius": config.sprocket_radius},
            "slip_laws": {"icr_radius": {"values": {"offset": law.offset, "radius_error": law.radius_error}}},
            "radius": list(config.radii),
            "slip": {"outer": slip[:, 1], "inner": slip[:, 0]},
            "timing": {"wall_s": wall, "stages": {"predict": wall}},
        }
        store.write_json(folder / store.SUMMARY, summary)
        store.write_json(folder / store.MANIFEST, store.manifest("predict", config, wall))
    rows = [(f"{r:g}", f"{s[1]:+.4f}", f"{s[0]:+.4f}") for r, s in zip(config.radii, slip, strict=True)]
    print_table("Slip by quasi-static Coulomb theory", ("radius driven [m]", "outer slip", "inner slip"), rows)
    print(f"D = {1e3 * law.offset:.2f} mm; use it with --laws {config.out}")


def predict(config: PredictConfig) -> ConstantIcr:
    """The constant ICR that theory gives: the same for every radius and speed.

    Raises:
        InvalidValueError: for a centre of mass that would lift part of a track.
    """
    contact = line_contact(
        config.half_gauge,
        config.contact_length / 2,
        along=1.0,
        across=config.friction_ratio,
        centre_of_mass=(config.com_x, 0.0, 0.0),
    )
    left, right = 1.0, 1.4  # any turn will do
    yaw_rate = steady_twist([left, right], contact)[2]
    return ConstantIcr((right - left) / (2 * yaw_rate) - config.half_gauge, config.half_gauge, config.radius_error)
