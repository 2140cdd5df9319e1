"""ROS 2 without ROS: a team's beliefs as messages of nodes that use rmw_zenoh, and their odometry and poses for robots of the team.

Extra `ros`; the formats are those of rmw_zenoh's design document, checked against `hiroz` (docs/ros2.md).
"""
