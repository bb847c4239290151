"""Identified laws for other programs: parameters of ros2_control, JSON, and code in C and Python."""
