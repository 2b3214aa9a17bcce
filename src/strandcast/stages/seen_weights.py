"""What weights that the tracker saw, but nobody declared there, would change in the fit."""

from collections.abc import Sequence

import numpy as np

from strandcast.arm.load import Arm
from strandcast.estimation.estimate import estimate
from strandcast.estimation.measured import Throw
from strandcast.records.track import DetectedWeight
from strandcast.stages.context import Context
from strandcast.stages.past_trials import string_model
from strandcast.tracking.attachments.declared_vs_detected import compared_weights

PAYS = 0.9  # chosen: a fit is better if E falls below this share; another free mass alone lowers it a little


def seen_weights_warnings(
    context: Context,
    arm: Arm,
    throws: list[Throw],
    declared_E_m: float,
    seen: Sequence[DetectedWeight],
    random: np.random.Generator,
) -> list[str]:
    """Return a warning with both errors if weights were seen at other places than declared.

    The throws are fitted again with the seen weights added to the declared ones and, where a declared weight
    may be the one that was seen elsewhere, with that one moved.

    Parameters
    ----------
    declared_E_m
        E of the fit with the declared weights [m].
    seen
        The weights that the tracker detected in the newest throw.
    """
    declared_m = [weight.place_m for weight in context.settings.string.weights]
    displaced, undeclared = compared_weights(seen, declared_m)
    if not displaced and not undeclared:
        return []
    new_m = [weight.place_m for weight in (*(weight for _, weight in displaced), *undeclared)]
    moved_m = [place for place in declared_m if place not in [former for former, _ in displaced]] + new_m
    settings = context.settings.estimate.model_copy(update={"profiles": False})
    found = {
        places_m: estimate(throws, *string_model(context, arm, places_m), settings, random).E_m
        for places_m in sorted({tuple(sorted(moved_m)), tuple(sorted(declared_m + new_m))}, key=len)
    }
    fewest, most = min(found, key=len), max(found, key=len)
    places_m = most if found[most] < PAYS * found[fewest] else fewest
    E_m = found[places_m]
    better = E_m < PAYS * declared_E_m
    return [
        f"string.weights: the tracker saw a weight {_mm(new_m)} from the clamp, where none is declared; the "
        f"fit's E is {1e3 * declared_E_m:.1f} mm, and {1e3 * E_m:.1f} mm with weights at {_mm(places_m)}: "
        + ("declare these places" if better else "it may be a knot or a mark that weighs little")
    ]


def _mm(places_m: Sequence[float]) -> str:
    return " and ".join(f"{1e3 * place:.0f}" for place in places_m) + " mm"
