"""Slip laws, which map the motion of the robot to the slip of its (left, right) tracks.

Most laws depend only on the curvature of the path, because the slip of a slow robot depends only on
the radius (paper, Sec. III-C). Curvature is signed, kappa = w / v (positive: counter-clockwise when
driving forwards), so that a straight path, kappa = 0, is not a special case. Except in laws with
values for each side, such as `IcrSides`, right turns mirror left turns. Parameters may be arrays
that broadcast against the curvatures, for many laws at once.
"""
