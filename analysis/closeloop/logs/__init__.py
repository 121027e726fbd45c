"""Logs as robots write them: CSV, MATLAB, HDF5 and ROS bags, read into named channels."""
