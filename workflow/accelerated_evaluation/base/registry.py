"""Registries: members of one kind by name, each in its own module, which the registry finds automatically."""

import importlib
import pkgutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from difflib import get_close_matches
from typing import Generic, TypeVar

from accelerated_evaluation.base.errors import InputError

Member = TypeVar("Member")


class Registry(Mapping[str, Member], Generic[Member]):
    """The members of one kind by name: laws, distributions, vehicles, methods or sources.

    A member registers itself with the decorator `add`, in the module that defines it. To find a member, the
    registry imports the module that has the name of the member. If there is no such module, it imports all
    modules of the package and of its subpackages. Adding a member therefore needs one new file and no entry
    in any list, and modules that are not needed are not imported. ``what`` is the name of the kind in
    messages, such as ``"vehicle"``. ``package`` and its ``__path__`` contain the modules of the members.
    """

    def __init__(self, what: str, package: str, path: Iterable[str], attribute: str | None = None) -> None:
        self.what = what
        self._package, self._path = package, path
        self._attribute = attribute  # of a member, which is set to its name
        self._members: dict[str, Member] = {}
        self._is_complete = False

    def add(self, name: str) -> Callable[[Member], Member]:
        """Return a decorator that registers a class or function under a name.

        ValueError is raised if another member already has the name.
        """

        def register(member: Member) -> Member:
            if self._members.get(name, member) is not member:
                raise ValueError(f"two members of the registry of each {self.what} are called {name!r}")
            self._members[name] = member
            if self._attribute is not None:
                setattr(member, self._attribute, name)
            return member

        return register

    def __getitem__(self, name: str) -> Member:
        """Return the member with a name; raise InputError with the known names if there is none."""
        if name not in self:
            near = get_close_matches(str(name), self._members, n=1)
            raise InputError(
                self.what,
                seen=repr(name),
                expected=f"one of {', '.join(self)}",
                change=f"Did you mean {near[0]}?" if near else "Name one of these.",
            )
        return self._members[name]

    def __contains__(self, name: object) -> bool:
        """Return whether there is a member with this name.

        The module of the same name is imported first. The others, which may be large, are imported only if
        the name is not found there.
        """
        if name not in self._members:
            self._import_namesake(name)
        if name not in self._members:
            self._complete()
        return name in self._members

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names in alphabetical order, which does not depend on the order of imports."""
        self._complete()
        return iter(sorted(self._members))

    def __len__(self) -> int:
        """Return the number of members."""
        self._complete()
        return len(self._members)

    def _import_namesake(self, name: object) -> None:
        """Import the module that has the name of a member, if there is one."""
        for module in pkgutil.walk_packages(self._path, f"{self._package}."):
            if module.name.rpartition(".")[2] == name:
                importlib.import_module(module.name)

    def _complete(self) -> None:
        """Import all modules of the package, once."""
        if not self._is_complete:
            self._is_complete = True  # set first, because a module may look up a member while it is imported
            for module in pkgutil.walk_packages(self._path, f"{self._package}."):
                importlib.import_module(module.name)
