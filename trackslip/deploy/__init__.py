"""Identified laws for other programs: parameters for ros2_control, JSON, and code in C and
Python.
"""
