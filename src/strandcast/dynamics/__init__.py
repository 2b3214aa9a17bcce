"""The planar string model: parameters, forces, simulation."""
