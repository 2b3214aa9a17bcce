"""Observations and camera records to metres: track.parquet, markers.parquet."""

from strandcast.reconstruction.plane import reconstruct
from strandcast.records.camera import Camera
from strandcast.records.observations import read_observations
from strandcast.records.tables import write_table
from strandcast.records.track import MARKERS, TRACK
from strandcast.stages.job import Files, Job


def run(job: Job, files: Files) -> None:
    """Reconstruct the track of one trial in the plane, as its one camera saw it."""
    observed = read_observations(files.input("observations"))
    track, markers = reconstruct(observed, Camera.read(files.input("cameras")))
    write_table(files.output("track"), TRACK, track.columns())
    write_table(files.output("markers"), MARKERS, markers)
