"""The arm: kinematics from the URDF, limits, servo response, and how a planar throw lives on it."""
