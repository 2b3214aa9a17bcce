"""The command that lists the strings of a project."""

from typing import Any

from strandcast.cli.common import ROOT, AsJson, show


def strings(as_json: AsJson = False) -> None:
    """List the strings of a project: what is known and fitted of each, and where; for start_string."""
    import strandcast
    from strandcast.errors import StrandcastError

    project = strandcast.open(ROOT)
    rows, unread = [], []
    for name in project:
        try:
            if (row := fitted_string(project[name])) is not None:
                rows.append(row)
        except StrandcastError as problem:
            unread.append(str(problem))
    lines = [line for row in rows for line in lines_of(row)]
    lines = lines or ["no string has been fitted here: `strandcast run EXPERIMENT` fits one"]
    show(as_json, {"strings": rows, "unread": unread}, [*lines, *unread])


def fitted_string(experiment: Any) -> dict[str, Any] | None:
    """Return what an experiment knows of its string, by its newest fit; None before the first."""
    trials = experiment.trials.items()
    fitted = [number for number, trial in trials if (trial.folder.results / "estimate.json").is_file()]
    if not fitted:
        return None
    newest, settings = experiment.trials[max(fitted)], experiment.settings
    estimate, summary = newest.estimate.record, newest.record("track.json")
    thickness_m = settings.string.thickness_m or summary.choices.get("thickness_m")
    lab = None if settings.lab is None else settings.lab.string
    return {
        "name": experiment.name,
        "length_m": estimate.length_m,
        "thickness_m": thickness_m,
        "mass_per_length_kg_m": settings.string.mass_per_length_kg_m
        or getattr(lab, "linear_density_kg_m", None),
        "weights": [weight.model_dump() | {"words": weight.words} for weight in estimate.weights],
        "parameters": [each.model_dump() for each in estimate.parameters],
        "arm": experiment.arm.name,
        "camera": settings.camera_name,
        "trial": max(fitted),
        "trials_used": estimate.trials_used,
        "E_m": estimate.E_m,
    }


def lines_of(row: dict[str, Any]) -> list[str]:
    """Return a string's row in words."""
    known = [f"{1e3 * row['length_m']:.0f} mm long"]
    if row["thickness_m"]:
        known.append(f"{1e3 * row['thickness_m']:.1f} mm thick")
    if row["mass_per_length_kg_m"]:
        known.append(f"{1e3 * row['mass_per_length_kg_m']:.1f} g/m")
    known += [
        f"{weight['kind']} at {1e3 * weight['place_m']:.0f} mm of {weight['words']}"
        for weight in row["weights"]
    ]
    trials = ", ".join(map(str, row["trials_used"]))
    return [
        f"{row['name']}: {', '.join(known)}",
        f"  fitted to trial {trials} with {row['arm']}, to {1e3 * row['E_m']:.1f} mm; "
        f"start_string: {{from: {row['name']}}}",
    ]
