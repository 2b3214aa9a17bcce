"""Video and track to the film of the throw on the page: clip.json."""

import numpy as np

from strandcast.records.clip import Clip
from strandcast.records.manifest import Manifest
from strandcast.records.track import TrackSummary, read_track
from strandcast.stages.cameras import read_camera
from strandcast.stages.job import Files, Job
from strandcast.tracking.clip import make_clip


def run(job: Job, files: Files) -> None:
    """Cut the film of one trial's throw."""
    context = job.context
    facts = Manifest.read(files.input("manifest")).video
    summary = TrackSummary.read(files.input("summary"))
    made = make_clip(
        job.folder.data / facts.file,
        facts,
        read_track(files.input("track"), summary.points),
        read_camera(context, files.input("cameras")),
        None if context.settings.target_m is None else np.array(context.settings.target_m),
    )
    Clip(experiment=context.name, trial=job.trial, **made).write(files.output("clip"))
