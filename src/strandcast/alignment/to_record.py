"""alignment.json from a fit, or from sync events alone."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from strandcast.alignment.checks import NORMAL
from strandcast.alignment.events import CONTRADICTION, clock_of_events
from strandcast.alignment.fine_fit import Candidate, ClockFit
from strandcast.alignment.problem import EventPair, Priors
from strandcast.errors import StrandcastError
from strandcast.records.alignment import Alignment, HandMarkerFit, SyncCheck
from strandcast.records.record import RigFault
from strandcast.rig.model import Rig


def sync_check(event: EventPair, fit: ClockFit, kind: str, used: bool) -> SyncCheck:
    """Return the comparison of an event with the hand's motion."""
    return SyncCheck(
        camera_time_s=event.camera_s,
        robot_time_s=event.robot_s,
        sigma_s=event.sigma_s,
        difference_s=fit.robot_s(event.camera_s) - event.robot_s,
        motion_se_s=fit.robot_se_s(event.camera_s),
        kind=kind,
        used=used,
    )


def record_of_fit(
    best: Candidate,
    rig: Rig,
    priors: Priors,
    heading: Mapping[str, Any],
    checks: Sequence[SyncCheck],
    faults: list[RigFault],
    warnings: Sequence[str],
) -> Alignment:
    """Return the record of a fit to the hand's motion; `heading` has the fields of every alignment."""
    fit, error, covered = best.fit, best.fit.rig_error, best.covered
    return Alignment(
        **heading,
        source="fit",
        offset_s=fit.offset_s(),
        offset_se_s=fit.robot_se_s(0.0),
        drift=fit.drift,
        drift_se=fit.drift_se,
        drift_prior=priors.drift,
        known_drift=priors.known_drift,
        residual_rms_m=best.residual_m,
        frames=len(np.unique(covered.time_s)),
        marker_shift_m=error.shift_m.mean(axis=0).tolist(),
        marker_turn_rad=float(error.turn_rad.mean()),
        base_shift_m=error.base_m.tolist(),
        joint_zero_rad=error.zero_rad.tolist(),
        link_length_m=error.length_m.tolist(),
        stretch=error.stretch.tolist(),
        markers=[_marker_fit(best, name, index) for index, name in enumerate(rig.ids)],
        middle_se_s=fit.middle_se_s,
        middle_camera_time_s=fit.middle_camera_s,
        unaided_se_s=fit.unaided_se_s,
        slow_error_m=fit.slow_m,
        wrong_rows=int(best.path.outlier.sum()),
        sync_events=list(checks),
        warnings=list(warnings),
        faults=faults,
    )


def _marker_fit(best: Candidate, name: int, index: int) -> HandMarkerFit:
    mine = best.covered.marker == index
    return HandMarkerFit(
        marker=name,
        shift_m=best.fit.rig_error.shift_m[index].tolist(),
        turn_rad=float(best.fit.rig_error.turn_rad[index]),
        sightings=int(mine.sum()),
        wrong=int(best.fit.outlier[mine].sum()),
    )


def record_of_events(events: list[EventPair], priors: Priors, heading: Mapping[str, Any]) -> Alignment:
    """Return the record of an alignment by sync events alone: the hand does not move.

    SC-A018: the events contradict each other.
    """
    found, covariance, middle_s = clock_of_events(events, priors.known_drift, priors.drift)
    offset_s = float(found[0] - (1.0 + found[1]) * middle_s)
    for event in events:
        off_s = event.robot_s - offset_s - (1.0 + found[1]) * event.camera_s
        if abs(off_s) > CONTRADICTION * event.sigma_s:
            raise StrandcastError(
                "SC-A018",
                f"the sync event at {event.camera_s:.4f} s is {off_s * 1e3:+.2f} ms "
                f"(± {event.sigma_s * 1e3:.2f}) from the clock by all {len(events)} events",
                field="align.sync_events",
                cost=f"one of the clocks is wrong by {abs(off_s) * 1e3:.1f} ms",
            )
    back = np.array([1.0, -middle_s])
    se_s = float(np.sqrt(back @ covariance @ back))
    half_ms = NORMAL * float(np.sqrt(covariance[0, 0])) * 1e3
    return Alignment(
        **heading,
        source="event",
        offset_s=offset_s,
        offset_se_s=se_s,
        drift=float(found[1]),
        drift_se=float(np.sqrt(covariance[1, 1])),
        drift_prior=priors.drift,
        known_drift=priors.known_drift,
        residual_rms_m=None,
        frames=0,
        middle_se_s=float(np.sqrt(covariance[0, 0])),
        middle_camera_time_s=middle_s,
        warnings=[
            f"the hand does not move: the offset rests on {len(events)} sync event(s) alone "
            f"(± {half_ms:.2f} ms, 95 %), without a check"
        ],
    )
