"""Board photos and plane photo to camera.json."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from strandcast.camera.flat import flat_camera
from strandcast.camera.lens import calibrate_lens
from strandcast.camera.markers import CharucoBoard
from strandcast.camera.plane import PlaneMarker, plane_from_markers
from strandcast.errors import StrandcastError
from strandcast.experiment import CameraSettings, find_experiment, load_experiment
from strandcast.layout import ExperimentFolder
from strandcast.progress import progress
