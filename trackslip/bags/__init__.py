"""ROS 1 and ROS 2 bags, read without ROS: topics, messages, and logs of drives."""
