"""Slip laws: from the motion of the robot to the slip of its (left, right) tracks.

Most laws depend on the curvature of the path alone, because the slip of a slow robot depends on the radius only (paper,
Sec. III-C). Curvature is signed, kappa = w / v (positive: counter-clockwise when driving forwards), so that a straight
path, kappa = 0, is not a special case. Right turns mirror left turns except for `IcrSides`: the inner track always
follows the inner track's law. Parameters may be arrays that broadcast against the curvatures, for many laws at once.
"""
