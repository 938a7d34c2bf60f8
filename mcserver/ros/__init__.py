"""ROS 2 over Zenoh: machines as nodes for whoever speaks rmw_zenoh, without ROS on this computer."""
