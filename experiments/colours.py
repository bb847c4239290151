"""Colours and names that mean the same in every figure and recording."""

from __future__ import annotations

BLUE, ORANGE, GREEN, VERMILLION, BLACK = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#1a1a1a"
COLOURS = {
    "none": VERMILLION,
    "published": BLACK,
    "constant": "#8a8a8a",
    "exponential": "#CC79A7",
    "exponential_speed": ORANGE,
    "power": GREEN,
    "hyperbola": "#8C510A",
    "icr": "#56B4E9",
    "icr_radius": BLUE,
    "icr_sides": "#6A3D9A",
    "online": "#117733",
    "online_cold": "#999933",
}
"""The same colour for the same slip law in every figure (Okabe and Ito's palette, and three more)."""
LABELS = {
    "none": "no slip assumed",
    "published": "published law (Eq. 11)",
    "constant": "constant slip",
    "exponential": "exponential",
    "exponential_speed": "exponential with speed",
    "power": "power of radius",
    "hyperbola": "hyperbola",
    "icr": "constant ICR",
    "icr_radius": "constant ICR with ε",
    "icr_sides": "constant ICR, two-sided",
    "online": "online",
    "online_cold": "online, from nothing",
}
"""What a law, or a compensation by it, is called."""
