"""A motion as a URScript program: the controller holds the whole table and plays it at its own rate.

It needs no network and no real-time PC while playing. The program asks before it moves, brings the arm slowly
to the start, stops if the arm is not there, asks again, plays, and stops.
"""

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.executor.drivers.ur_settings import JOINTS, UrSettings
from strandcast.executor.handover.handover import Handover
from strandcast.executor.move_to_start import ACCELERATION_RAD_S2, SPEED_RAD_S

OUTPUTS = 8
ROWS_A_LIST = 50  # lists and lines stay short: no limit on either is documented
HOLD_S = 0.3  # the joints arrive after their command
STOP_RAD_S2 = 4.0  # chosen

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

  popup("{start_prompt}", "strandcast", True, False, True)
  movej(start, {start_acceleration}, {start_speed})
  sleep(1.0)
  sc_check_start(start, allowed)
  popup("{throw_prompt}", "strandcast", True, False, True)
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


def program_text(handover: Handover, rate_hz: float | None = None, sync_output: int | None = None) -> str:
    """Return the program.

    Parameters
    ----------
    rate_hz
        Rate of the controller: 500 (e-Series) or 125 (CB3). By default that of the driver `ur`, or 500.
    sync_output
        Standard digital output that is high from the first row to the stop, for an LED in the camera's view;
        by default that of the driver, or none.

    Raises
    ------
    StrandcastError
        SC-E004 the arm does not have six joints; unknown output or rate.
    """
    motion, arm = handover.motion, handover.arm
    settings = {name: field.default for name, field in UrSettings.model_fields.items()}
    settings |= arm.driver_settings if arm.driver == "ur" else {}  # as when played by the driver
    rate_hz = rate_hz or settings["rate_hz"]
    sync_output = settings["sync_output"] if sync_output is None else sync_output
    _refuse(handover, rate_hz, sync_output)
    rows = handover.command(rate_hz).q_rad
    joints = handover.joints
    lists = [f"sc_q{joint}" for joint in joints.moving_index]
    tables, calls = [], []
    for block, first in enumerate(range(0, len(rows), ROWS_A_LIST)):
        part = rows[first : first + ROWS_A_LIST]
        names = [f"{name}_{block}" for name in lists]
        tables += [f"  {name} = {_list(column)}" for name, column in zip(names, part.T, strict=True)]
        calls.append(f"  sc_play({', '.join(names)}, {len(part)})\n")
    row = [_number(angle) for angle in joints.held_rad]
    for joint, name in zip(joints.moving_index, lists, strict=True):
        row[joint] = f"{name}[sc_k]"
    allowed = np.full(JOINTS, float(arm.start_tolerance_rad.min()))
    allowed[joints.moving_index] = np.minimum(arm.start_tolerance_rad, motion.start.tolerance_rad)
    return PROGRAM.format(
        about="\n".join(f"# {line}" for line in handover.about()),
        arguments=", ".join(lists),
        row=", ".join(row),
        rows=len(rows),
        tables="\n".join(tables),
        calls="".join(calls),
        start=_list(joints.all_angles(rows[0])),
        end=_list(joints.all_angles(rows[-1])),
        allowed=_list(allowed),
        still=_list(np.full(JOINTS, arm.start_velocity_rad_s)),
        step=f"{1.0 / rate_hz:g}",
        lookahead=settings["look_ahead_s"],
        gain=f"{settings['gain']:g}",
        stop=STOP_RAD_S2,
        hold_rows=round(HOLD_S * rate_hz),
        start_speed=SPEED_RAD_S,
        start_acceleration=ACCELERATION_RAD_S2,
        short=handover.short_hash,
        start_prompt=f"Motion {handover.short_hash}: move SLOWLY to its start. Is the way free?",
        throw_prompt=_throw_prompt(handover),
        sync_on="" if sync_output is None else f"  set_standard_digital_out({sync_output}, True)\n",
        sync_off="" if sync_output is None else f"  set_standard_digital_out({sync_output}, False)\n",
    )


def _throw_prompt(handover: Handover) -> str:
    fast = "THROW" if handover.time_scale == 1 else f"play {handover.time_scale:g} times slower"
    takes = f"{handover.motion.trajectory().end_s:.2f} s"
    return f"At the start. {fast} now, {takes}? Camera on, slider at 100 percent, nobody near."


def _list(values: np.ndarray) -> str:
    return "[" + ", ".join(map(_number, values)) + "]"


def _number(value: float) -> str:
    return f"{value:.9f}"


def _refuse(handover: Handover, rate_hz: float, sync_output: int | None) -> None:
    arm = handover.arm
    if len(arm.all_joints) != JOINTS:
        raise StrandcastError(
            "SC-E004",
            f"a URScript program is for six joints; {arm.name} has {len(arm.all_joints)}",
            file=arm.path,
            fix="export the motion of a UR arm, or take --as csv or --as ros",
        )
    if sync_output is not None and not 0 <= sync_output < OUTPUTS:
        raise StrandcastError(
            "SC-E004",
            f"a UR has no standard digital output {sync_output}",
            field="sync-output",
            fix=f"0 to {OUTPUTS - 1}",
        )
    if rate_hz not in (500.0, 125.0):
        raise StrandcastError(
            "SC-E004",
            f"no UR controller runs at {rate_hz:g} Hz",
            field="rate",
            fix="500 (e-Series) or 125 (CB3)",
        )
