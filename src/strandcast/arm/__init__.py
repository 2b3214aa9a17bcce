"""The arm: kinematics from the URDF, limits, servo response, and how it makes a planar throw."""
