"""`method: paper`: the paper's method as a whole."""

from typing import Any

# What `method: paper` means where the file gives nothing else.
PRESET: dict[str, Any] = {
    "start_string": "minima",  # section VII-A
    "estimate": {
        "search": "paper",  # eq. 3; with it go the frame of E and the last point's mass
        "ranges": "paper",  # Table 2; relative masses 1 to 20, by Table 4
        "trials": "latest",  # section VI: the manipulation just made
        "start_shape": "hanging",  # not given: the paper does not mention the string's first shape
        "forces": "paper",  # no such parameters in Table 1
        "horizon_s": None,  # "the total number of images taken": the whole motion
    },
    "plan": {
        "duration_s": [0.2, 1.2],  # section V-A
        "evaluations": 2400,  # motions tried before the best so far is thrown; not given
    },
}


def with_method(data: dict[str, Any]) -> dict[str, Any]:
    """Return plain settings with those of the paper's method, where they ask for it and give no others."""
    if data.get("method") != "paper":
        return data
    sections = {
        name: preset | data.get(name, {})
        for name, preset in PRESET.items()
        if isinstance(preset, dict) and isinstance(data.get(name, {}), dict)
    }
    return PRESET | data | sections
