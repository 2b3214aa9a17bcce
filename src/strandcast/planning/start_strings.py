"""The plausible strings for a first motion."""

from dataclasses import replace
from typing import Any

import numpy as np

from strandcast.config.experiment import Experiment
from strandcast.core.strings import BEND_FRICTION, PARAMETERS, REST_CURL, TAPER, StringBatch
from strandcast.dynamics.masses import MassLayout, point_masses
from strandcast.dynamics.parameters import StringDraw, ensemble, log_uniform_array, minima, random_strings
from strandcast.planning.scenarios import STRINGS

# Drag along a string over that across it: from a smooth cord's skin friction to a fluffy thread's; chosen.
FIRST_DRAG_ALONG = (0.1, 0.7)
FIRST_CURL_RAD_M = 3.0  # cords come off a reel: they may rest bent this much either way; chosen

# From sewing thread to rope: strings that the plane's range, with which its misses were calibrated, leaves
# out missed most (docs/explanation/throws.md, "In space").
DENSITY_IN_SPACE_KG_M = (1e-3, 40e-3)
# Drag of a thrown string over that of a rigid cylinder: at Reynolds numbers below 100, and for long flexible
# cylinders that vibrate in the flow, coefficients up to 3 are measured (Vandiver, Drag coefficients of long
# flexible cylinders, OTC 4490, 1983).
DRAG_OF_CYLINDERS = (1.0, 2.7)


def start_strings_in_space(
    count: int, length_m: float, layout: MassLayout, random: np.random.Generator
) -> StringBatch:
    """Return plausible strings in space for a first motion: a free length [m], and weights on n points."""
    n = layout.shares.shape[1]
    draw = ensemble(count, length_m, n, layout.count, random, density_kg_m=DENSITY_IN_SPACE_KG_M)
    curl, turn = random.uniform(0.0, FIRST_CURL_RAD_M, count), random.uniform(0.0, 2.0 * np.pi, count)
    draw.parameters[:, PARAMETERS.index("C_c2")] *= log_uniform_array(random, *DRAG_OF_CYLINDERS, count)
    return StringBatch(
        draw.parameters,
        point_masses(layout, draw.weight_masses),
    ).with_values(
        rest_curl_rad_m=curl[:, None] * np.column_stack([np.cos(turn), np.sin(turn)]),
        drag_along=log_uniform_array(random, *FIRST_DRAG_ALONG, count),
    )


def rescaled(
    strings: StringBatch, fitted_m: tuple[float, float], length_m: float, layout: MassLayout
) -> StringBatch:
    """Return fitted strings with another free length or number of mass points, in their clamp.

    Parameters
    ----------
    strings
        The fitted strings, with as many free masses as the layout, and plain points of mass 1.
    fitted_m
        Free length and rest spacing of the fit [m].
    length_m, layout
        Free length now [m], and the weights on n points.
    """
    per = fitted_m[1] * layout.shares.shape[1] / length_m
    # All are per kilogram of a point's mass, which is proportional to the spacing; springs and dampers of a
    # segment or joint are also inverse to it. Drag acts along all of a segment.
    scale = np.array([1.0 if name.startswith("C_c") else per**2 for name in PARAMETERS])
    parameters, values = strings.parameters * scale, dict(strings.values)
    if BEND_FRICTION in values:
        values[BEND_FRICTION] = per * values[BEND_FRICTION]
    if TAPER in values:  # the end stays as it is
        joints = [PARAMETERS.index(name) for name in ("k_h", "c_h", "k_sh", "c_sh")]
        parameters[:, joints] *= np.exp(values[TAPER] * (0.5 - 0.5 * length_m / fitted_m[0]))[:, None]
        values[TAPER] = values[TAPER] * length_m / fitted_m[0]
    masses = point_masses(layout, per * strings.free_masses)
    return StringBatch(parameters, masses, values, stiff_joints=layout.stiff_joints())


def in_another_clamp(strings: StringBatch, random: np.random.Generator) -> StringBatch:
    """Return the strings held as in any clamp, and turned by any angle about themselves."""
    parameters = strings.parameters.copy()
    for clamp, joint in (("k_ph", "k_h"), ("c_ph", "c_h")):
        parameters[:, PARAMETERS.index(clamp)] = 2.0 * parameters[:, PARAMETERS.index(joint)]
    kept = {name: value for name, value in strings.values.items() if "offset" not in name}
    moved = replace(strings, parameters=parameters, values=kept)
    if not strings.in_space:
        side_of = random.choice([-1.0, 1.0], len(strings))
        return moved.with_values(rest_curl_rad_m=strings[REST_CURL] * side_of)
    turn = random.uniform(0.0, 2.0 * np.pi, len(strings))
    size = np.linalg.norm(strings.sides(REST_CURL), axis=1, keepdims=True)
    return moved.with_values(rest_curl_rad_m=size * np.column_stack([np.cos(turn), np.sin(turn)]))


def start_string_name(settings: Experiment) -> str:
    """Return the name of the first motion's strings in its record."""
    if settings.known_string is not None:
        return f"from {settings.known_string}"
    return settings.start_string if isinstance(settings.start_string, str) else "given"


def start_strings(
    settings: Experiment, length_m: float, layout: MassLayout, random: np.random.Generator
) -> StringBatch:
    """Return the strings that the first motion, or the rehearsal of a known string, is planned with."""
    start, string = settings.start_string, settings.string
    if start == "ensemble" or settings.known_string is not None:
        count, weights = STRINGS, layout.count - layout.stiff
        draw = ensemble(count, length_m, string.n, weights, random, layout.stiff, settings.string.thickness_m)
        curl = random.uniform(-FIRST_CURL_RAD_M, FIRST_CURL_RAD_M, count)
        return StringBatch(
            draw.parameters,
            point_masses(layout, draw.weight_masses),
        ).with_values(rest_curl_rad_m=curl, drag_along=log_uniform_array(random, *FIRST_DRAG_ALONG, count))
    if start == "random":
        draw = random_strings(1, layout.count, random)
    elif isinstance(start, dict):
        values: dict[Any, Any] = dict(start)
        given = [
            values.get(name, least) for name, least in zip(PARAMETERS, minima().parameters[0], strict=True)
        ]
        draw = StringDraw(np.array([given]), minima(layout.count).weight_masses)
    else:
        draw, layout = minima(layout.count), replace(layout, tip=1.0)  # the paper's plain points are alike
    return StringBatch(draw.parameters, point_masses(layout, draw.weight_masses))
