"""Verify a track and an alignment measured elsewhere, and copy them to the results."""

from strandcast.errors import StrandcastError
from strandcast.imports.track_checks import check_length, check_supplied
from strandcast.records.alignment import HAND, Alignment
from strandcast.records.tables import read_arrow, write_arrow
from strandcast.records.track import TRACK, TrackSummary, is_in_space
from strandcast.stages.context import refuse_other_target
from strandcast.stages.job import Files, Job


def run(job: Job, files: Files) -> None:
    """Copy track, summary, alignment and hand from data/ to results/, each after a verified read."""
    alignment = Alignment.read(files.input("alignment"))
    summary, declared = TrackSummary.read(files.input("summary")), job.context.settings.string.n
    track = read_arrow(files.input("track"), TRACK)
    in_space = is_in_space(track.column_names)
    refuse_other_target(job.context, in_space)
    if summary.points != declared and not in_space:
        what = f"the track has {summary.points} points, the experiment's string {declared}"
        fix = "set string.points in experiment.yaml, or import the track again"
        raise StrandcastError("SC-R021", what, file=files.input("summary"), field="points", fix=fix)
    found = check_length(summary.length_m, job.context.settings.string.length_m, files.input("summary"))
    found += check_supplied(files.input("track"), files.input("hand"), alignment, summary)
    summary.cameras = []  # also of a track that was joined elsewhere: its cameras are not this experiment's
    summary.warnings += [warning for warning in found if warning not in summary.warnings]
    write_arrow(files.output("track"), track)
    write_arrow(files.output("hand"), read_arrow(files.input("hand"), HAND))
    alignment.write(files.output("alignment"))
    summary.write(files.output("summary"))
