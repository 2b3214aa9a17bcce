"""Declared weights and stiff sections compared with the detected ones; the declaration wins."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from strandcast.records.track import DetectedWeight

if TYPE_CHECKING:  # it costs an import of scipy, and the estimate stage needs the pairing alone
    from strandcast.tracking.attachments.detect import Attachments

SIGMAS = 4.0
LEAST_M = 0.010  # a smaller difference of a weight's place is no conflict
LEAST_END_M = 0.015  # and of a section's end


def declaration_conflicts(
    found: Attachments, weights_m: list[float], sections_m: list[tuple[float, float]], length_m: float
) -> list[str]:
    """Return warnings about declared weights and sections that differ from the detected ones.

    Places are from the clamp on; those beyond the free length `length_m` are at the tip. A declared weight
    that is not detected is no conflict: a wire's weight is not visible. A detected one is no conflict where
    none is declared.
    """
    warnings = _weights(found, [min(place, length_m) for place in weights_m])
    for from_m, to_m in sections_m:
        warnings += _section(found, from_m, min(to_m, length_m))
    return warnings


def _weights(found: Attachments, declared_m: list[float]) -> list[str]:
    """Warn of weights that are detected far from where they are declared, and of undeclared ones."""
    displaced, undeclared = compared_weights(found.weights, declared_m)
    return [
        f"string.weights: a weight is declared at {_mm(place)} from the clamp and detected at "
        f"{_mm(weight.place_m, weight.sigma_m)}: {_mm(abs(weight.place_m - place))} off"
        for place, weight in displaced
    ] + [
        f"string.weights: an undeclared weight is detected at {_mm(w.place_m, w.sigma_m)} from the clamp"
        for w in (undeclared if declared_m else [])
    ]


def compared_weights(
    found: Sequence[DetectedWeight], declared_m: Sequence[float]
) -> tuple[list[tuple[float, DetectedWeight]], list[DetectedWeight]]:
    """Pair declared and detected weights, nearest first; return the distant pairs and the undeclared ones."""
    declared, detected, displaced = list(declared_m), list(found), []
    while declared and detected:
        place, weight = min(
            ((d, w) for d in declared for w in detected), key=lambda pair: abs(pair[0] - pair[1].place_m)
        )
        declared.remove(place)
        detected.remove(weight)
        if abs(weight.place_m - place) > max(LEAST_M, SIGMAS * weight.sigma_m):
            displaced.append((place, weight))
    return displaced, detected


def _section(found: Attachments, from_m: float, to_m: float) -> list[str]:
    """Warn of a declared section if the nearest detected one has other ends, or bends."""
    overlapping = [s for s in found.sections if s.from_m < to_m and s.to_m > from_m] or list(found.sections)
    if not overlapping:
        return []
    near = min(overlapping, key=lambda s: abs(s.from_m - from_m) + abs(s.to_m - to_m))
    off = (near.from_m - from_m, near.from_sigma_m), (near.to_m - to_m, near.to_sigma_m)
    text = (
        f"string.stiff_sections: declared from {_mm(from_m)} to {_mm(to_m)}, detected from "
        f"{_mm(near.from_m, near.from_sigma_m)} to {_mm(near.to_m, near.to_sigma_m)}"
    )
    if any(abs(error) > max(LEAST_END_M, SIGMAS * sigma) for error, sigma in off):
        return [f"{text} from the clamp"]
    return [f"{text}, but it bends"] if near.stiff is False else []


def _mm(place_m: float, sigma_m: float | None = None) -> str:
    sigma = "" if sigma_m is None else f" ± {1e3 * sigma_m:.1f}"
    return f"{1e3 * place_m:.0f}{sigma} mm"
