"""The observations of all cameras to one track."""

from typing import NamedTuple

import numpy as np

from strandcast.config.camera import only_camera
from strandcast.reconstruction.plane import intersect_plane, marker_poses
from strandcast.records.camera import Camera
from strandcast.records.observations import Observations
from strandcast.records.track import Track


class Reconstruction(NamedTuple):
    """The mass points, and the columns of markers.parquet."""

    track: Track
    markers: dict[str, np.ndarray]


def reconstruct(observations: dict[str, Observations], cameras: dict[str, Camera]) -> Reconstruction:
    """Return the track in metres from observations and cameras by name.

    One camera gives the track by intersection with the plane of motion. Several need their clocks too:
    `strandcast.reconstruction.views`.

    Raises
    ------
    StrandcastError
        SC-F003 there are several cameras.
    """
    name = only_camera(observations)
    found, camera = observations[name], cameras[name]
    return Reconstruction(intersect_plane(found.string, camera), marker_poses(found, camera))
