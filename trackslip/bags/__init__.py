"""Bags of ROS 1 and ROS 2, without ROS: their topics, their messages, and the logs of drives in them."""
