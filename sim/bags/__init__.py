"""Bags of simulated runs, and of commands to a robot, for ROS 2."""
