"""Predictions of one motion by a cable fitted to the other, and the effect of each part of the model."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from strandcast_studies.evidence.cable import Series
from strandcast_studies.evidence.figure import Figure
from strandcast_studies.evidence.pac_cable import (
    CABLE,
    CABLES,
    DRIVEN,
    FREE,
    fit,
    read,
    tip_error_mm,
    trivial_mm,
    weight_kg,
)

# What a variant leaves out of the model.
LEFT_OUT = {
    "stick": ("log_stick",),
    "friction": ("log_friction", "log_stick"),
    "curl": ("curl_rad_m",),
    "clamp_turn": ("clamp_rad",),
}
ADDED = ("log_clamp",)

_LOGARITHMS = {
    "log_stiffness": "stiffness_N_m2",
    "log_damping": "damping_N_m2_s",
    "log_friction": "friction_N_m",
    "log_stick": "stick_rad_m",
}


def measure(folder: Path) -> list[Figure]:
    """Return figures of the predictions in both directions, of the model's parts, and of the hand's delay."""
    free, driven = ({cable: read(folder, kind, cable) for cable in CABLES} for kind in (FREE, DRIVEN))
    weights = {cable: weight_kg(folder, cable) for cable in CABLES}
    return [
        *(_prediction(free[c], driven[c], weights[c]) for c in CABLES),
        *(_prediction(driven[c], free[c], weights[c]) for c in CABLES),
        *_parts(free, driven, weights),
        *_delay(free, driven, weights),
    ]


def _prediction(fitted: Series, other: Series, weight: float) -> Figure:
    """Return the figure of `other` as predicted by the cable fitted to `fitted`."""
    found = fit(fitted, CABLE, weight)
    error, trivial = tip_error_mm(other, found), trivial_mm(other, fitted)
    return Figure(
        f"pac_cable.tip.{fitted.cable}.{fitted.kind}_predicts_{other.kind}",
        error,
        "mm",
        min(trivial.values()),
        "mean over the series, without refitting; the target is the better predictor without a model",
        {
            "percent_of_length": 0.1 * error / other.length_m,
            "fitted_series_mm": tip_error_mm(fitted, found),
            **{f"{name}_mm": value for name, value in trivial.items()},
            **{
                _LOGARITHMS.get(name, name): float(np.exp(value)) if name in _LOGARITHMS else value
                for name, value in found.items()
            },
        },
    )


def _parts(free: dict[str, Series], driven: dict[str, Series], weights: dict[str, float]) -> list[Figure]:
    """Return figures of each motion predicted from the other, with parts of the model changed."""
    variants: dict[str, tuple[str, ...]] = {"as_it_is": CABLE}
    variants |= {
        f"without_{part}": tuple(name for name in CABLE if name not in names)
        for part, names in LEFT_OUT.items()
    }
    variants |= {f"with_{added}": (*CABLE, added) for added in ADDED}
    return [
        _mean(
            f"pac_cable.parts.{variant}.{fitted[CABLES[0]].kind}_predicts_{other[CABLES[0]].kind}",
            {c: tip_error_mm(other[c], fit(fitted[c], names, weights[c])) for c in CABLES},
        )
        for variant, names in variants.items()
        for fitted, other in ((free, driven), (driven, free))
    ]


def _delay(free: dict[str, Series], driven: dict[str, Series], weights: dict[str, float]) -> list[Figure]:
    """Return figures of the hand's delay, and of the prediction with the delay of the other cables.

    A free swing cannot show the delay, as its hand does not move.
    """
    delays = {c: fit(driven[c], (*CABLE, "delay_s"), weights[c])["delay_s"] for c in CABLES}
    errors = {}
    for c in CABLES:
        carried = {"delay_s": _median(delays[other] for other in CABLES if other != c)}
        errors[c] = tip_error_mm(driven[c], fit(free[c], CABLE, weights[c]) | carried)
    return [
        _mean(f"pac_cable.parts.with_delay_of_other_cables.{FREE}_predicts_{DRIVEN}", errors),
        Figure(
            "pac_cable.delay_of_the_hand",
            1e3 * _median(delays.values()),
            "ms",
            note="median of the driven series; negative: the end is recorded late, as by a rolling shutter",
            detail={c: 1e3 * delay for c, delay in delays.items()},
        ),
    ]


def _mean(name: str, errors: dict[str, float]) -> Figure:
    note = "mean of the cables"
    return Figure(name, float(np.mean(list(errors.values()))), "mm", note=note, detail=dict(errors))


def _median(values: Iterable[float]) -> float:
    return float(np.median(list(values)))
