"""The command that simulates a string without an experiment."""

from pathlib import Path
from typing import Annotated, Any

import typer

from strandcast.cli.common import AsJson, show

# Arguments of `simulate` and the columns of the path that give them; z is there of a path in space.
COLUMNS = {
    "place_m": ("x_m", "y_m", "z_m"),
    "direction": ("direction_x", "direction_y", "direction_z"),
    "far_place_m": ("far_x_m", "far_y_m", "far_z_m"),
    "far_direction": ("far_direction_x", "far_direction_y", "far_direction_z"),
}


def weight(argument: str) -> tuple[float, float]:
    """Return place [m] and mass [kg] of a weight that an argument gives as PLACE:MASS."""
    try:
        place_m, mass_kg = map(float, argument.split(":"))
    except ValueError:
        raise typer.BadParameter(f"{argument!r} is not PLACE:MASS, as in 0.5:0.010") from None
    return place_m, mass_kg


def simulate(
    path: Annotated[
        Path,
        typer.Argument(
            metavar="PATH",
            help="CSV of the string's end: time_s, x_m, y_m, in space z_m; docs/how-to/simulate-a-string.md.",
        ),
    ],
    length: Annotated[float, typer.Option(help="Free length [m].")],
    material: Annotated[
        str, typer.Option(help="cotton cord, rope, cable, fishing line or chain: for what is not given.")
    ] = "cotton cord",
    diameter: Annotated[float | None, typer.Option(help="Diameter [m].")] = None,
    mass_per_length: Annotated[float | None, typer.Option(help="Mass per length [kg/m].")] = None,
    bending: Annotated[float | None, typer.Option(help="Bending stiffness [N m²].")] = None,
    damping: Annotated[float | None, typer.Option(help="Bending damping over stiffness [s].")] = None,
    curl: Annotated[float, typer.Option(help="Bend without load, in the plane [rad/m].")] = 0.0,
    weights: Annotated[
        list[Any] | None,
        typer.Option("--weight", metavar="PLACE:MASS", parser=weight, help="A weight [m:kg]; repeat."),
    ] = None,
    points: Annotated[int, typer.Option(help="Number of mass points.")] = 40,
    rate: Annotated[
        float | None,
        typer.Option(min=0.1, max=1e5, help="Times per second of the result.  [default: the path's times]"),
    ] = None,
    out: Annotated[Path, typer.Option(help="CSV to write: time_s, point, x_m, y_m, in space z_m.")] = Path(
        "simulated.csv"
    ),
    as_json: AsJson = False,
) -> None:
    """Simulate a string with one or two moving ends: a CSV of its points."""
    import numpy as np
    import pandas as pd

    from strandcast.api import simulate as simulate_string
    from strandcast.imports.table import read_numbers
    from strandcast.records.files import write_text

    if out.resolve() == path.resolve():
        raise typer.BadParameter("it is the path itself: nothing would be left of it", param_hint="--out")
    table = read_numbers(path)
    table.require_finite(table.columns(["time_s"]), ["time_s"])
    time_s = table.times("time_s", 1.0)
    axes = 3 if any(columns[2] in table.names for columns in COLUMNS.values()) else 2
    given: dict[str, Any] = {}
    for name, columns in COLUMNS.items():
        if name == "place_m" or any(column in table.names for column in columns):
            given[name] = table.columns(list(columns[:axes]))
            table.require_finite(given[name], list(columns[:axes]))
    known = [column for columns in COLUMNS.values() for column in columns]
    unknown = [each for each in table.names if each.startswith(("far", "direction")) and each not in known]
    if unknown:
        raise typer.BadParameter(f"{path}: columns are named {', '.join(known)}, not {unknown[0]}")
    if rate is not None:
        given["out_time_s"] = np.arange(time_s[0], time_s[-1] + 1e-9, 1.0 / rate)
    points_m = simulate_string(
        time_s,
        given.pop("place_m"),
        length_m=length,
        material=material,
        diameter_m=diameter,
        mass_kg_m=mass_per_length,
        bending_n_m2=bending,
        damping_s=damping,
        rest_curl_rad_m=curl,
        weights=weights or (),
        points=points,
        **given,
    )
    at = given.get("out_time_s", time_s)
    row, point = (index.ravel() for index in np.indices(points_m.shape[:2]))
    coordinates = dict(zip(COLUMNS["place_m"], points_m.reshape(-1, axes).T, strict=False))
    result = pd.DataFrame({"time_s": at[row], "point": point} | coordinates)
    write_text(out, result.to_csv(index=False, float_format="%.6f"))
    line = f"{out}: {len(at)} times of {points + 1} points"
    if len(at) > 1:
        speed = np.linalg.norm(np.diff(points_m[:, -1], axis=0), axis=1) / np.diff(at)
        fastest = int(np.argmax(speed))
        line += f"; the last one is fastest at {at[fastest]:.3f} s, {speed[fastest]:.2f} m/s"
    show(as_json, {"file": out, "times": len(at), "points": points + 1}, [*table.notes, line])
