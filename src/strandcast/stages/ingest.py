"""Raw video, joint log and played motion to manifest.json: hashes, counts, time stamps, gaps."""

from pathlib import Path

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.folders import VIDEO
from strandcast.records.joint_log import JointLog, Run, read_run
from strandcast.records.manifest import LogFacts, Manifest
from strandcast.records.motion import Motion
from strandcast.records.record import read_json
from strandcast.stages.job import Files, Job
from strandcast.video.checks import check_cover, check_recorded, unchanged, warnings_of
from strandcast.video.ingest import inspect_video


def run(job: Job, files: Files) -> None:
    """Write the manifest; the raw files stay as they are."""
    context, camera = job.context, job.context.settings.camera
    path = job.folder.video()
    with unchanged(path):
        video = inspect_video(path, camera.frame_rate_hz, camera.missing_policy)
    record, planned = files.optional("run"), files.optional("motion")
    played_run, joint_log = read_run(record.parent) if record else (None, None)
    log = None if played_run is None or joint_log is None else _log_facts(played_run, joint_log)
    own = {"video": (path, video.sha256)}
    if record is not None and log is not None and not job.is_lab:
        own["joint_log"] = record.with_name(log.file), log.sha256
    _refuse_files_of_another_trial(own, files.inputs("others"))
    check_recorded(path, video, played_run)
    check_cover(path, video, played_run)
    played = Motion.read(planned) if planned else None
    motion = None if played is None else played.content_sha256()
    if played_run is not None and planned is not None and played_run.motion_sha256 not in (None, motion):
        raise StrandcastError(
            "SC-X020",
            "is not the motion that run.json says was played",
            file=planned,
            cost="the fit would be made for another motion",
            exit_code=INTEGRITY,
        )
    warnings = (
        warnings_of(video, log) + _log_warnings(log) + _foreign(played, context.folder.experiment, job.trial)
    )
    others = job.folder.other_films() if job.folder.films == (VIDEO,) else []  # else of other cameras
    if others:
        warnings.append(f"{', '.join(others)} not read, only {path.name}: join the parts of a throw's film")
    Manifest(
        experiment=context.name,
        trial=job.trial,
        video=video,
        joint_log=log,
        motion_sha256=motion,
        target_m=None if played is None else played.target_m,
        warnings=warnings,
    ).write(files.output("manifest"))


def _refuse_files_of_another_trial(own: dict[str, tuple[Path, str]], manifests: list[Path]) -> None:
    """Refuse a video or a joint log that another trial has: each with its hash, by the manifest's name."""
    for other in manifests:
        record = read_json(other)
        for kind, (path, sha256) in own.items():
            if (record.get(kind) or {}).get("sha256") == sha256:
                raise StrandcastError(
                    "SC-V023",
                    f"is the {kind.replace('_', ' ')} of {other.parent.name}, byte for byte",
                    file=path,
                    cost="another throw would be tracked, or one throw counted twice",
                    fix="copy this trial's own file; exclude or remove a trial that is there twice; "
                    f"if the two were exchanged and are right now, delete {other}",
                    exit_code=INTEGRITY,
                )


def _log_facts(run_record: Run, log: JointLog) -> LogFacts:
    return LogFacts(
        file="joints.csv",
        sha256=run_record.joints_sha256,
        rows=run_record.rows,
        start_s=float(log.time_s[0]),
        end_s=float(log.time_s[-1]),
        rate_hz=run_record.timing.rate_hz,
        gaps=run_record.timing.gaps,
        duplicates=run_record.timing.duplicates,
    )


def _foreign(played: Motion | None, name: str, trial: int) -> list[str]:
    """Warn of a motion that was planned for another trial: a repeated throw, or a misplaced folder."""
    if played is None or (played.experiment, played.trial) == (name, trial):
        return []
    return [f"motion.json was planned for {played.experiment} trial {played.trial}"]


def _log_warnings(log: LogFacts | None) -> list[str]:
    if log is None:
        return []
    found = []
    if log.gaps:
        worst = max(gap.duration_s for gap in log.gaps)
        found.append(f"{log.file}: {len(log.gaps)} gaps, up to {worst:.4f} s")
    if log.duplicates:
        found.append(f"{log.file}: {log.duplicates} rows with the time of the one before")
    return found
