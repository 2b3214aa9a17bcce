"""The camera's clock on the robot's: the hand that the video saw against the hand that the joints tell."""
