"""Camera clock to robot clock: alignment.json and hand.parquet."""

from strandcast.alignment.align import RobotData, VideoData, align
from strandcast.alignment.hand_path import hand_table
from strandcast.arm.load import load_arm
from strandcast.records.alignment import HAND
from strandcast.records.joint_log import read_run
from strandcast.records.motion import Motion
from strandcast.records.tables import read_table, write_table
from strandcast.records.track import MARKERS, TrackSummary
from strandcast.stages.job import Files, Job


def run(job: Job, files: Files) -> None:
    """Align one trial."""
    context, settings = job.context, job.context.settings.align
    arm = load_arm(files.input("arm")).planar()
    played, log = read_run(job.folder.data)
    markers = read_table(files.input("markers"), MARKERS)
    led = None if settings.led is None else TrackSummary.read(files.input("summary")).led
    start_s, end_s = played.motion_start_s, played.motion_end_s
    motion_s = None if start_s is None or end_s is None else (start_s, end_s)
    planned = files.optional("motion")
    predicted = Motion.read(planned).predicted if planned else None
    alignment = align(
        VideoData(markers, led),
        RobotData(log, played.sync_events, motion_s, str(files.input("joints"))),
        arm,
        settings,
        experiment=context.name,
        trial=job.trial,
        tip_speed_m_s=predicted.peak_tip_speed_m_s if predicted else None,
    )
    alignment.camera = context.settings.camera_name
    alignment.write(files.output("alignment"))
    write_table(files.output("hand"), HAND, hand_table(alignment, markers, log, arm))
