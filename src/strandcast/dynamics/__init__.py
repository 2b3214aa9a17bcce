"""The planar string model: parameters, forces, integrators, simulation."""
