"""The virtual arm, string and camera: they take a motion and leave the raw files that a real rig would leave."""
