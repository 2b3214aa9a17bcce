"""Motions handed over as files to arms that have no driver: a ROS goal, a CSV table, a URScript program."""
