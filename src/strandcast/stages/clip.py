"""Video and track to the film of the throw on the page: clip.json."""

from strandcast.records.camera import Camera
from strandcast.records.clip import Clip
from strandcast.records.manifest import Manifest
from strandcast.records.track import TrackSummary, read_track
from strandcast.stages.context import aimed_at
from strandcast.stages.job import Files, Job
from strandcast.tracking.clip import make_clip


def run(job: Job, files: Files) -> None:
    """Cut the film of one trial's throw."""
    context = job.context
    manifest = Manifest.read(files.input("manifest"))
    summary = TrackSummary.read(files.input("summary"))
    made = make_clip(
        job.folder.data / manifest.video.file,
        manifest.video,
        read_track(files.input("track"), summary.points),
        Camera.read(files.input("cameras")),
        aimed_at(context, manifest),
    )
    Clip(experiment=context.name, trial=job.trial, **made).write(files.output("clip"))
