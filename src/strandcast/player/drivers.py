"""Drivers by name: what the arm's file calls them, found among the installed packages' entry points."""

from __future__ import annotations

from importlib.metadata import entry_points

from strandcast.arm.load import Arm
from strandcast.errors import ENVIRONMENT, StrandcastError
from strandcast.player.protocol import Driver
from strandcast.records.motion import Motion

GROUP = "strandcast.drivers"


def driver_named(name: str, arm: Arm, motion: Motion) -> Driver:
    """Return the driver that an arm's file names.

    A package offers one as an entry point of the group ``strandcast.drivers``: a function of the arm and the
    motion that returns an object with the methods of `player.protocol.Driver`.

    Raises
    ------
    StrandcastError
        No installed package offers such a driver.
    """
    offered = {point.name: point for point in entry_points(group=GROUP)}
    if name not in offered:
        raise StrandcastError(
            "SC-X030",
            f"no driver {name!r} is installed; there are: {', '.join(sorted(offered)) or 'none'}",
            file=arm.path,
            field="driver.name",
            fix="name one of these, or install the package that offers it",
            exit_code=ENVIRONMENT,
        )
    driver: Driver = offered[name].load()(arm, motion)
    return driver


def missing_package(package: str, extra: str, error: ImportError) -> StrandcastError:
    """Return what to tell when a vendor's package is not installed."""
    return StrandcastError(
        "SC-X032", f"the driver needs the package {package!r}, which is not installed ({error})",
        fix=f"pip install 'strandcast[{extra}]'", exit_code=ENVIRONMENT)  # fmt: skip


def refuse_nowhere(arm: Arm, address: str) -> None:
    """Refuse to connect where the arm's file names no controller."""
    if not address:
        raise StrandcastError(
            "SC-X033", "the arm's file does not say where its controller is", file=arm.path,
            field="driver.settings.host", cost="nothing was sent to the arm",
            fix="give its address, then plan again: a motion is bound to the arm's file")  # fmt: skip
