"""Models of kind `mjcf`: an MJCF or URDF file that factors change and whose sensors are read."""
