"""Find a driver by the name in the arm's file, among the entry points of the installed packages."""

from collections.abc import Callable
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from strandcast.arm.load import Arm
from strandcast.core.registry import Registry
from strandcast.errors import ENVIRONMENT, StrandcastError, StrandcastErrors
from strandcast.executor.drivers.protocol import Driver
from strandcast.executor.locks import NOTHING_SENT
from strandcast.records.motion import Motion

# The built-in drivers are entry points as well: the lab's lies above this room.
DRIVERS: Registry[Callable[[Arm, Motion], Driver]] = Registry(
    "arm driver", "strandcast.drivers", "driver.name"
)
Model = TypeVar("Model", bound=BaseModel)


def driver_of_arm(arm: Arm, motion: Motion) -> Driver:
    """Return the driver that an arm's file names, for a motion (SC-W021: there is none)."""
    if arm.driver is None:
        raise StrandcastError(
            "SC-W021",
            "the arm has no driver",
            file=arm.path,
            field="driver.name",
            fix="strandcast export motion writes the motion as a file for its own software",
        )
    return DRIVERS.get(arm.driver, arm.path)(arm, motion)


def driver_settings(model: type[Model], arm: Arm) -> Model:
    """Return `[driver.settings]` of an arm's file as a driver's settings; report every invalid key."""
    try:
        return model.model_validate(arm.driver_settings)
    except ValidationError as error:
        raise StrandcastErrors(
            [
                StrandcastError(
                    "SC-F003",
                    problem["msg"] + _given(problem["input"]),
                    file=arm.path,
                    field=".".join(["driver", "settings", *map(str, problem["loc"])]),
                    cost=NOTHING_SENT,
                    fix=f"see `{model.__module__}.{model.__name__}`, which explains every key",
                )
                for problem in error.errors()
            ]
        ) from None


def _given(value: object) -> str:
    return "" if isinstance(value, dict) else f" (is {value!r})"


def missing_package(package: str, extra: str, error: ImportError) -> StrandcastError:
    """Return the error for a vendor's package that is not installed."""
    return StrandcastError(
        "SC-W012",
        f"the driver needs the package {package!r}, which is not installed ({error})",
        fix=f"pip install 'strandcast[{extra}]'",
        exit_code=ENVIRONMENT,
    )


def require_address(arm: Arm, address: str) -> None:
    """Refuse to connect if the arm's file has no address of its controller (SC-F003)."""
    if not address:
        raise StrandcastError(
            "SC-F003",
            "the arm's file has no address of its controller",
            file=arm.path,
            field="driver.settings.host",
            cost=NOTHING_SENT,
            fix="enter the address, then plan again: a motion is bound to the arm's file",
        )


def no_connection(arm: Arm, what: str, fix: str) -> StrandcastError:
    """Return the error for a controller that cannot be used over its address."""
    return StrandcastError(
        "SC-X061",
        what,
        file=arm.path,
        field="driver.settings.host",
        cost=NOTHING_SENT,
        fix=fix,
        exit_code=ENVIRONMENT,
    )
