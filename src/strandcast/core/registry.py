"""The extension points: entries by name, built in, registered at run time, or of an installed package."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar

from strandcast.errors import ENVIRONMENT, StrandcastError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

Entry = TypeVar("Entry")


def installed(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of a group that the installed packages offer, in order of name."""
    from importlib.metadata import entry_points  # on use: the process that decodes a video needs none

    return {point.name: point for point in sorted(entry_points(group=group), key=lambda point: point.name)}


class Registry(Generic[Entry]):
    """The entries of one extension point by name: the built-in `entries`, and others.

    `what` is a word for an entry, for messages; `field` is the setting that gives the name. `group` is that
    of the entry points of installed packages: one is imported when an unknown name is requested.
    """

    def __init__(
        self, what: str, group: str, field: str | None = None, entries: Mapping[str, Entry] | None = None
    ) -> None:
        self.what, self.group, self.field = what, group, field
        self._entries = dict(entries or {})
        self._listeners: list[Callable[[], object]] = []

    def __iter__(self) -> Iterator[str]:
        """Iterate over all names: the built-in and registered ones in order, then those of packages."""
        return iter(self._entries | installed(self.group))

    def known(self) -> dict[str, Entry]:
        """Return the entries that are built in, registered or imported already."""
        return dict(self._entries)

    def register(self, name: str, entry: Entry) -> None:
        """Add an entry under a name, which must be free."""
        if name in self._entries:
            raise ValueError(f"{name!r} is registered already as {self.what}")
        self._entries[name] = entry
        for listener in self._listeners:
            listener()

    def on_registration(self, listener: Callable[[], object]) -> None:
        """Call a function whenever an entry is added."""
        self._listeners.append(listener)

    def find(self, name: str) -> Entry | None:
        """Return the entry with this name, None if there is none.

        Raises
        ------
        StrandcastError
            SC-W013 it cannot be imported.
        """
        if name not in self._entries and (point := installed(self.group).get(name)):
            entry = self._load(point)
            if name not in self._entries:  # the module may have registered it
                self.register(name, entry)
        return self._entries.get(name)

    def get(self, name: str, file: Path | str | None = None) -> Entry:
        """Return the entry with this name; `file` names it and is only for the message.

        Raises
        ------
        StrandcastError
            SC-W021 there is no such entry; SC-W013 it cannot be imported.
        """
        entry = self.find(name)
        if entry is None:
            import difflib

            names = sorted(self)
            near = difflib.get_close_matches(name, names, n=1)
            raise StrandcastError(
                "SC-W021",
                f"there is no {self.what} {name!r}; available: {', '.join(names) or 'none'}",
                file=file,
                field=self.field,
                fix=(f"did you mean {near[0]!r}? " if near else "")
                + "Name one of these, or install the package that provides it",
                exit_code=ENVIRONMENT,
            )
        return entry

    def _load(self, point: EntryPoint) -> Entry:
        try:
            entry: Entry = point.load()
            return entry
        except Exception as error:
            raise StrandcastError(
                "SC-W013",
                f"the {self.what} {point.name!r} ({point.value}) cannot be imported: "
                f"{type(error).__name__}: {error}",
                field=self.field,
                fix="install the package that provides it again",
                exit_code=ENVIRONMENT,
            ) from error
