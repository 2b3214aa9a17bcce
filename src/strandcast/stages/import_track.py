"""Import motion capture into a trial's folder as track, hand and alignment."""

from pathlib import Path

from strandcast.arm.load import load_arm
from strandcast.imports.capture_in_space import import_capture_in_space
from strandcast.imports.mapping import CaptureMapping
from strandcast.imports.motion_capture import import_capture
from strandcast.imports.space_mapping import SpaceMapping
from strandcast.records.track import TrackSummary
from strandcast.stages.context import context_of, free_length_m, refuse_replacing, refuse_target_in_space


def run(
    root: Path,
    name: str,
    trial: int,
    capture: Path,
    mapping: CaptureMapping | SpaceMapping,
    replace: bool = False,
) -> TrackSummary:
    """Import a capture; `register_track` copies it to the results."""
    context = context_of(root, name)
    string, folder = context.settings.string, context.folder.trial(trial)
    refuse_replacing(folder.data / "track.json", replace)
    if isinstance(mapping, SpaceMapping):
        refuse_target_in_space(context, True)
        return import_capture_in_space(
            capture, folder.data, mapping, experiment=name, trial=trial, length_m=string.length_m
        )
    arm = load_arm(context.arm_file)
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
