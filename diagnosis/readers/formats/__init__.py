"""Readers of files that anybody may have: tables, MATLAB, MDF and MCAP files, ROS bags."""
