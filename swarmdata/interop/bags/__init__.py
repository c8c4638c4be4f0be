"""Bags of ROS 2 messages: MCAP files and rosbag2 folders. Write only."""
