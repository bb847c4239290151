"""Simulated teleoperated drives: sprocket commands, the robot's motion, and poses from any
sensor.
"""
