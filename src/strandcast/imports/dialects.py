"""Joint logs of known makers, recognised by their columns."""

import re
from typing import Literal

from strandcast.errors import StrandcastError
from strandcast.imports.mapping import JointMapping
from strandcast.imports.table import NumberTable

UR_JOINTS = 6
UR_PLAIN_COLUMNS = tuple(1 + groups * UR_JOINTS for groups in (2, 3, 5))
UR_OUTPUTS = "actual_digital_output_bits"


def libfranka(table: NumberTable) -> JointMapping | None:
    """Read ``q[0]``, ``q_d[0]``, ``dq[0]``, or ``state.q[0]`` … as libfranka's logToCSV writes them.

    Where it names the robot's state and the command alike, the state is the first of the two.
    """
    own = bool(_counted(table, r"state\.q\[(\d+)\]"))
    stem = "state." if own else ""
    joints = _counted(table, re.escape(stem) + r"q\[(\d+)\]")
    clock = next((name for name in ("duration", "time", "t") if name in table.names), None)
    if not joints:
        return None
    unit: Literal["ms", "s"] = "ms" if own or clock == "duration" else "s"  # logToCSV writes milliseconds
    numbers = range(len(joints))
    return JointMapping(
        time=clock,
        time_unit=unit,
        q=joints,
        qd=_if_present(table, [f"{stem}dq[{k}]" for k in numbers]),
        q_cmd=_if_present(table, [f"{stem}q_d[{k}]" for k in numbers]),
        qd_cmd=_if_present(table, [f"{stem}dq_d[{k}]" for k in numbers]),
        rate_hz=1000.0,
    )


def ur_rtde(table: NumberTable) -> JointMapping | None:
    """Read ur_rtde and UR's record.py: ``timestamp``, ``actual_q_0`` or ``actual_q[0]`` …, ``target_q_0``."""
    joints = _counted(table, r"actual_q[_\[](\d+)\]?")
    if not joints:
        return None

    def alike(quantity: str) -> list[str]:
        return _if_present(table, [name.replace("actual_q", quantity, 1) for name in joints])

    return JointMapping(
        time="timestamp" if "timestamp" in table.names else None,
        q=joints,
        qd=alike("actual_qd"),
        q_cmd=alike("target_q"),
        qd_cmd=alike("target_qd"),
        outputs=UR_OUTPUTS if UR_OUTPUTS in table.names else None,
    )


def ur_plain(table: NumberTable) -> JointMapping | None:
    """Read UR logs without header: t, q (6), qd (6), current (6), desired current (6), desired torque (6).

    The last two groups of columns, or the last three, may be missing.
    """
    if table.has_header or len(table.names) not in UR_PLAIN_COLUMNS:
        return None
    return JointMapping(
        time="1",
        q=[str(2 + k) for k in range(UR_JOINTS)],
        qd=[str(2 + UR_JOINTS + k) for k in range(UR_JOINTS)],
    )


DIALECTS = {"libfranka": libfranka, "ur_rtde": ur_rtde, "ur": ur_plain}


def recognise(table: NumberTable, dialect: str = "auto") -> tuple[str, JointMapping]:
    """Return the dialect's name and its columns.

    Raises
    ------
    StrandcastError
        No dialect fits, or not the named one.
    """
    if dialect != "auto" and dialect not in DIALECTS:
        raise StrandcastError(
            "SC-I011",
            f"there is no dialect {dialect!r}",
            field="dialect",
            fix=f"use one of auto, {', '.join(DIALECTS)}, or give a column mapping",
        )
    for name in DIALECTS if dialect == "auto" else [dialect]:
        mapping = DIALECTS[name](table)
        if mapping is not None:
            return name, mapping
    raise StrandcastError(
        "SC-I004",
        f"the columns match no known joint log: {', '.join(table.names[:12])} …",
        file=table.path,
        fix="correct a misspelt column, or name the columns in a TOML file and give it with --columns: time, "
        "q, and if available qd, q_cmd, qd_cmd; time_unit, angle_unit",
    )


def _counted(table: NumberTable, pattern: str) -> list[str]:
    """Return the columns that match a pattern, numbered from 0 without gaps."""
    found = sorted({(int(m.group(1)), name) for name in table.names if (m := re.fullmatch(pattern, name))})
    return [name for _, name in found] if [k for k, _ in found] == list(range(len(found))) else []


def _if_present(table: NumberTable, names: list[str]) -> list[str]:
    """Return the first column of each name, or none where one is missing."""
    if not all(name in table.names for name in names):
        return []
    return [f"{name}@{table.names.index(name) + 1}" for name in names]
