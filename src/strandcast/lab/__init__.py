"""The virtual arm, string and camera: they leave the raw files that a real rig would leave."""
