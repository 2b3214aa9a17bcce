"""The virtual arm, string and camera, which write the same raw files as a real rig."""
