"""What the experiment says is on the string, held against what is seen there: what is typed counts."""

from __future__ import annotations

from strandcast.tracking.attachments import Attachments

SIGMAS = 4.0
LEAST_M = 0.010  # a weight that is less off is where it was typed
LEAST_END_M = 0.015  # of a section's end


def against_typed(
    found: Attachments, weights_m: list[float], sections_m: list[tuple[float, float]], length_m: float
) -> list[str]:
    """Return what to warn of where the string is seen to be another than the one that was typed.

    Parameters
    ----------
    found
        What is seen on the string.
    weights_m, sections_m
        Places of the typed weights, ends of the typed stiff sections, from the clamp on.
    length_m
        Of the string beyond the clamp; what was typed beyond it sits at the tip.

    Notes
    -----
    What is typed but not seen is no contradiction: a wire's weight does not show. Nor is a bump that was not
    typed, where nothing was typed: the places are then taken from what is seen.
    """
    warnings = _weights(found, [min(place, length_m) for place in weights_m])
    for from_m, to_m in sections_m:
        warnings += _section(found, from_m, min(to_m, length_m))
    return warnings


def _weights(found: Attachments, typed_m: list[float]) -> list[str]:
    """Pair typed and seen weights, the nearest first; tell of pairs too far apart, and of the rest."""
    typed, seen, warnings = list(typed_m), list(found.weights), []
    while typed and seen:
        place, weight = min(
            ((t, w) for t in typed for w in seen), key=lambda pair: abs(pair[0] - pair[1].place_m)
        )
        typed.remove(place)
        seen.remove(weight)
        off_m = weight.place_m - place
        if abs(off_m) > max(LEAST_M, SIGMAS * weight.sigma_m):
            warnings.append(
                f"string.weights: a weight is typed at {_mm(place)} from the clamp and seen at "
                f"{_mm(weight.place_m, weight.sigma_m)}: {_mm(abs(off_m))} off"
            )
    if typed_m:
        warnings += [
            f"string.weights: a weight that is not typed is seen at {_mm(weight.place_m, weight.sigma_m)} "
            "from the clamp"
            for weight in seen
        ]
    return warnings


def _section(found: Attachments, from_m: float, to_m: float) -> list[str]:
    """Tell of a typed section whose nearest seen one has other ends, or bends."""
    overlapping = [s for s in found.sections if s.from_m < to_m and s.to_m > from_m] or list(found.sections)
    if not overlapping:
        return []
    near = min(overlapping, key=lambda s: abs(s.from_m - from_m) + abs(s.to_m - to_m))
    off = (near.from_m - from_m, near.from_sigma_m), (near.to_m - to_m, near.to_sigma_m)
    typed = f"string.stiff_sections: typed from {_mm(from_m)} to {_mm(to_m)}"
    seen = f"seen from {_mm(near.from_m, near.from_sigma_m)} to {_mm(near.to_m, near.to_sigma_m)}"
    if any(abs(error) > max(LEAST_END_M, SIGMAS * sigma) for error, sigma in off):
        return [f"{typed}, {seen} from the clamp"]
    return [f"{typed}, {seen}, but it is seen to bend"] if near.stiff is False else []


def _mm(place_m: float, sigma_m: float | None = None) -> str:
    sigma = "" if sigma_m is None else f" ± {1e3 * sigma_m:.1f}"
    return f"{1e3 * place_m:.0f}{sigma} mm"
