"""Slip laws: motion -> slip of the (left, right) tracks.

Most laws take a path's curvature alone: on a slow robot slip depends on the path's radius only (paper, Sec. III-C).
Curvature is signed, kappa = w / v (positive: counter-clockwise when driving forwards), so that a straight path is
kappa = 0 and nothing special. Right turns mirror left turns, but for `IcrSides`: the inner law goes to the inner track.
A law's parameters may be arrays, any shape that broadcasts against the curvatures: many laws at once.
"""
