"""A motion as a URScript program: the whole table lies on the controller, which plays it at its own rate.

No network and no real-time PC are between table and servo. The program asks before it moves, brings the arm
to the start slowly, refuses a start that it has not reached, asks again, plays, and stops.
"""

from __future__ import annotations

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.exports.handover import APPROACH_RAD_S, HandOver
from strandcast.player.checks import sample

JOINTS = 6
OUTPUTS = 8
RATE_HZ = 500.0
ROWS_A_LIST = 50  # lists and lines stay short: no limit on either is documented
APPROACH_RAD_S2 = 0.5
HOLD_S = 0.3  # the joints arrive after their command
STOP_RAD_S2 = 4.0
LOOKAHEAD_S = 0.03  # the least that servoj takes: the arm trails by 34 ms
GAIN = 2000.0

PROGRAM = """\
{about}
def strandcast_throw():
  # True where a joint is further than `allowed` from where it should be.
  def sc_away(q, wanted, allowed):
    sc_i = 0
    while sc_i < 6:
      if norm(q[sc_i] - wanted[sc_i]) > allowed[sc_i]:
        return True
      end
      sc_i = sc_i + 1
    end
    return False
  end

  # Stops the program unless the arm stands still at the start.
  def sc_check_start(start, allowed):
    if sc_away(get_actual_joint_positions(), start, allowed):
      popup("The arm is not at the start of the motion. Nothing was thrown.", "strandcast", False, True, True)
      halt
    end
    if sc_away(get_actual_joint_speeds(), [0, 0, 0, 0, 0, 0], {still}):
      popup("The arm still moves. Nothing was thrown.", "strandcast", False, True, True)
      halt
    end
  end

  # One call of servoj for each row, {step} s each: the controller keeps the time.
  def sc_play({arguments}, rows):
    sc_k = 0
    while sc_k < rows:
      servoj([{row}], t={step}, lookahead_time={lookahead}, gain={gain})
      sc_k = sc_k + 1
    end
  end

  # The motion, {rows} rows [rad].
{tables}

  start = {start}
  allowed = {allowed}
  textmsg("strandcast motion ", "{short}")

  popup("{approach_words}", "strandcast", True, False, True)
  movej(start, {approach_acceleration}, {approach_speed})
  sleep(1.0)
  sc_check_start(start, allowed)
  popup("{throw_words}", "strandcast", True, False, True)
  sc_check_start(start, allowed)

{sync_on}{calls}
  # Hold the end until the joints have arrived.
  sc_k = 0
  while sc_k < {hold_rows}:
    servoj({end}, t={step}, lookahead_time={lookahead}, gain={gain})
    sc_k = sc_k + 1
  end
  stopj({stop})
{sync_off}  textmsg("strandcast motion played ", "{short}")
end
"""


def program_text(handover: HandOver, rate_hz: float | None = None, sync_output: int | None = None) -> str:
    """Return the program.

    Parameters
    ----------
    rate_hz
        The controller's: 500 (e-Series) or 125 (CB3). By default as the driver `ur` is told, else 500.
    sync_output
        Standard digital output that is high from the first row to the stop, for an LED in the camera's view;
        by default as the driver is told, else none.

    Raises
    ------
    StrandcastError
        SC-E010 the arm has not six joints; SC-E011 no such output; SC-E012 no such rate.
    """
    motion, arm = handover.motion, handover.arm
    settings = arm.driver_settings if arm.driver == "ur" else {}  # then it does as it does with the driver
    rate_hz = rate_hz or settings.get("rate_hz", RATE_HZ)
    sync_output = settings.get("sync_output") if sync_output is None else sync_output
    _refuse(handover, rate_hz, sync_output)
    rows = sample(motion, 1.0 / rate_hz).q_rad
    moving = [arm.all_joints.index(name) for name in motion.joint_names]
    lists = [f"sc_q{joint}" for joint in moving]
    tables, calls = [], []
    for block, first in enumerate(range(0, len(rows), ROWS_A_LIST)):
        part = rows[first : first + ROWS_A_LIST]
        names = [f"{name}_{block}" for name in lists]
        tables += [f"  {name} = {_list(column)}" for name, column in zip(names, part.T, strict=True)]
        calls.append(f"  sc_play({', '.join(names)}, {len(part)})\n")
    row = [_number(arm.held.get(name, 0.0)) for name in arm.all_joints]
    for joint, name in zip(moving, lists, strict=True):
        row[joint] = f"{name}[sc_k]"
    allowed = np.full(JOINTS, float(arm.start_tolerance_rad.min()))
    allowed[moving] = np.minimum(arm.start_tolerance_rad, motion.start.tolerance_rad)
    return PROGRAM.format(
        about="\n".join(f"# {line}" for line in handover.about()),
        arguments=", ".join(lists),
        row=", ".join(row),
        rows=len(rows),
        tables="\n".join(tables),
        calls="".join(calls),
        start=_list(_posture(handover, rows[0])),
        end=_list(_posture(handover, rows[-1])),
        allowed=_list(allowed),
        still=_list(np.full(JOINTS, arm.start_velocity_rad_s)),
        step=f"{1.0 / rate_hz:g}",
        lookahead=settings.get("look_ahead_s", LOOKAHEAD_S),
        gain=f"{settings.get('gain', GAIN):g}",
        stop=STOP_RAD_S2,
        hold_rows=round(HOLD_S * rate_hz),
        approach_speed=APPROACH_RAD_S,
        approach_acceleration=APPROACH_RAD_S2,
        short=handover.short_hash,
        approach_words=f"Motion {handover.short_hash}: move SLOWLY to its start. Is the way free?",
        throw_words=_throw_words(handover),
        sync_on="" if sync_output is None else f"  set_standard_digital_out({sync_output}, True)\n",
        sync_off="" if sync_output is None else f"  set_standard_digital_out({sync_output}, False)\n",
    )


def _throw_words(handover: HandOver) -> str:
    fast = "THROW" if handover.time_scale == 1 else f"play {handover.time_scale:g} times slower"
    takes = f"{handover.motion.time_s()[-1]:.2f} s"
    return f"At the start. {fast} now, {takes}? Camera on, slider at 100 percent, nobody near."


def _posture(handover: HandOver, q: np.ndarray) -> np.ndarray:
    """Return (6,) angles of all joints from (J,) of the moving ones."""
    angles = handover.arm.held | dict(zip(handover.motion.joint_names, q.tolist(), strict=True))
    return np.array([angles[name] for name in handover.arm.all_joints])


def _list(values: np.ndarray) -> str:
    return "[" + ", ".join(map(_number, values)) + "]"


def _number(value: float) -> str:
    return f"{value:.9f}"


def _refuse(handover: HandOver, rate_hz: float, sync_output: int | None) -> None:
    arm = handover.arm
    if len(arm.all_joints) != JOINTS:
        raise StrandcastError(
            "SC-E010",
            f"a URScript program is for six joints; {arm.name} has {len(arm.all_joints)}",
            file=arm.path,
            fix="export the motion of a UR arm, or take --as csv or --as ros",
        )
    if sync_output is not None and not 0 <= sync_output < OUTPUTS:
        raise StrandcastError(
            "SC-E011",
            f"a UR has no standard digital output {sync_output}",
            field="sync-output",
            fix=f"0 to {OUTPUTS - 1}",
        )
    if rate_hz not in (500.0, 125.0):
        raise StrandcastError(
            "SC-E012",
            f"no UR controller runs at {rate_hz:g} Hz",
            field="rate",
            fix="500 (e-Series) or 125 (CB3)",
        )
