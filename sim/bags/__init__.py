"""ROS 2 bags with simulated runs or with commands for a robot."""
