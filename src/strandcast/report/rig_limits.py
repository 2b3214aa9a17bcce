"""What is good of a rig: the limits by which the pages mark a trial. All are chosen."""

MOST_DRIFT = 1e-4  # of the camera's clock against the robot's: 0.1 ms in a second
LEAST_MARKER_FRACTION = 0.95  # of the frames show the hand's markers
MOST_SERVO_RESIDUAL_RAD = 5e-3  # rms that the servo's model leaves
MOST_LENS_RMS_PX = 0.5
MOST_PLANE_RMS_PX = 1.0
