"""The domain's types, each declared once: strings, poses, trajectories, objectives, disturbances. No I/O."""
