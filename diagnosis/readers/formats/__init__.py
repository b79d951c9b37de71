"""Readers of files that anybody may have: tables, MATLAB files, ROS bags."""
