"""The camera's clock on the robot's clock: the hand in the video compared with the hand by the joints."""
