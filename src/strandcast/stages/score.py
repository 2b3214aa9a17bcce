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
        words = miss_in_words(verdict, verdict.hit_radius_m)
        print_line(f"score: trial {job.trial}: {words if verdict.reason is None else verdict.reason}")


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
    verdict = score_throw(track, alignment, aim, summary.length_m, plane_error, summary.tip_sigma_m)
    if verdict.reason is not None and cameras and track.points_m.shape[2] == 2:
        from strandcast.camera.mapping import leaves_picture  # loads OpenCV: only where it is asked for

        outside = track.frame[leaves_picture(cameras[0], track.points_m)]
        if len(outside):
            frames = f"{len(outside)} frames, {outside[0]} to {outside[-1]}"
            verdict.reason += f"; the string leaves the picture in {frames}: move the camera back, or aim it"
    return verdict
