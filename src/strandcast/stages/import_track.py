"""Import motion capture into a trial's folder as track, hand and alignment."""

from pathlib import Path

from strandcast.arm.load import load_arm
from strandcast.imports.mapping import CaptureMapping
from strandcast.imports.motion_capture import import_capture
from strandcast.records.track import TrackSummary
from strandcast.stages.context import context_of, free_length_m, refuse_replacing


def run(
    root: Path, name: str, trial: int, capture: Path, mapping: CaptureMapping, replace: bool = False
) -> TrackSummary:
    """Import a capture; `register_track` copies it to the results."""
    context = context_of(root, name)
    string, folder = context.settings.string, context.folder.trial(trial)
    arm = load_arm(context.arm_file)
    refuse_replacing(folder.data / "track.json", replace)
    return import_capture(
        capture,
        folder.data,
        mapping,
        experiment=name,
        trial=trial,
        length_m=free_length_m(context, arm.clamp.clamped_length_m),
        points=string.n,
        arm=arm,
        aimed=context.settings.target_m is not None,
    )
