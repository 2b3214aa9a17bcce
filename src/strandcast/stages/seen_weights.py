"""What weights that the tracker saw, but nobody declared there, would change in the fit."""

from collections.abc import Sequence

import numpy as np

from strandcast.arm.load import PlanarArm
from strandcast.estimation.estimate import estimate_throws
from strandcast.estimation.measured import Throw
from strandcast.records.record import RigFault
from strandcast.records.track import DetectedWeight
from strandcast.stages.context import Context, free_length_m
from strandcast.stages.past_trials import string_model
from strandcast.tracking.attachments.declared_vs_detected import compared_weights

PAYS = 0.9  # chosen: a fit is better if E falls below this share; another free mass alone lowers it a little


def seen_weights(
    context: Context,
    arm: PlanarArm,
    throws: list[Throw],
    declared_E_m: float,
    seen: Sequence[DetectedWeight],
    random: np.random.Generator,
) -> tuple[list[RigFault], list[str]]:
    """Return faults of the declared weights, and warnings of what may be none, with the E of both fits.

    The throws are fitted again with the weights where they were seen: those that are nearest to declared ones
    instead of these. A place that explains the throws no better may be a knot or a mark.

    Parameters
    ----------
    declared_E_m
        E of the fit with the declared weights [m].
    seen
        The weights that the tracker detected in the newest throw.
    """
    free_m = free_length_m(context, arm.clamp.clamped_length_m)
    declared_m = [min(weight.place_m, free_m) for weight in context.settings.string.weights]
    displaced, undeclared = compared_weights(seen, declared_m)
    if not displaced and not undeclared:
        return [], []
    stay_m = [place for place in declared_m if place not in [former for former, _ in displaced]]
    new_m = [weight.place_m for weight in (*(weight for _, weight in displaced), *undeclared)]
    places_m = tuple(sorted(stay_m + new_m))
    settings = context.settings.estimate.model_copy(update={"profiles": False})
    E_m = estimate_throws(throws, *string_model(context, arm, places_m), settings, random).E_m
    tried = (
        f"the fit's E is {1e3 * declared_E_m:.1f} mm, and {1e3 * E_m:.1f} mm with weights at {_mm(places_m)}"
    )
    faults = [
        _fault(
            f"string.weights: the weight declared {_mm([place])} from the clamp is seen "
            f"{1e3 * weight.place_m:.1f} ± {1e3 * weight.sigma_m:.1f} mm from it; {tried}",
            f"measure it. As seen, its place_m is {weight.place_m:.3f}",
        )
        for place, weight in displaced
        if E_m <= declared_E_m
    ]
    left_m = [weight.place_m for weight in undeclared] if faults else new_m
    what = f"string.weights: a weight is seen {_mm(left_m)} from the clamp, where none is declared; {tried}"
    if not left_m:
        return faults, []
    if E_m < PAYS * declared_E_m:
        return [*faults, _fault(what, "declare these places")], []
    return faults, [f"{what}: it may be a knot or a mark that weighs little"]


def _fault(what: str, fix: str) -> RigFault:
    return RigFault(
        what=what,
        cost="the string is fitted, and motions are planned, with a weight in the wrong place",
        fix=fix,
        field="string.weights",
    )


def _mm(places_m: Sequence[float]) -> str:
    return " and ".join(f"{1e3 * place:.0f}" for place in places_m) + " mm"
