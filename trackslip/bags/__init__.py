"""ROS 1 and ROS 2 bags, read without ROS: their topics, their messages, and the logs of the drives in them."""
