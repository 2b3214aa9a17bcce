"""By how much a throw missed its objective: verdict.json."""

from strandcast.progress import print_line
from strandcast.records.alignment import Alignment
from strandcast.records.camera import Camera
from strandcast.records.summary import miss_in_words
from strandcast.records.track import TrackSummary, read_track
from strandcast.records.verdict import Verdict
from strandcast.scoring.score import Aim, score_throw, without_target
from strandcast.stages.job import Files, Job


def run(job: Job, files: Files) -> None:
    """Score one trial."""
    verdict = verdict_of(job, files)
    verdict.write(files.output("verdict"))
    if verdict.target_m is not None:
        print_line(f"score: trial {job.trial}: {miss_in_words(verdict, verdict.hit_radius_m)}")


def verdict_of(job: Job, files: Files) -> Verdict:
    """Return the verdict of one trial."""
    settings = job.context.settings
    summary = TrackSummary.read(files.input("summary"))
    track = read_track(files.input("track"), summary.points)
    alignment = Alignment.read(files.input("alignment"))
    if settings.aim is None or settings.target_m is None:
        return without_target(job.context.name, job.trial, settings.hit_radius_m)
    cameras = [Camera.read(path) for path in files.inputs("cameras")]
    plane_error = cameras[0].plane_error if cameras else None
    aim = Aim(job.context.name, job.trial, settings.aim, settings.target_m, settings.hit_radius_m)
    return score_throw(track, alignment, aim, summary.length_m, plane_error, summary.tip_sigma_m)
