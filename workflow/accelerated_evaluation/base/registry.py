"""Registries: members of one kind by name, each in its own module, which the registry finds automatically."""

import importlib
import pkgutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from typing import Any, Generic, TypeVar

from accelerated_evaluation.base import extensions
from accelerated_evaluation.base.arguments import described
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.users_code import guard

Member = TypeVar("Member")
ABSTRACT = "__isabstractmethod__"  # attribute of Python that marks abstract methods


class Registry(Mapping[str, Member], Generic[Member]):
    """The members of one kind by name: laws, distributions, vehicles, methods or sources.

    A member registers itself with the decorator `add`, in the module that defines it. To find a member, the
    registry imports the module that has the name of the member. If there is no such module, it imports the
    extensions (`base.extensions`), and then all modules of the package and of its subpackages. Adding a
    member therefore needs one new file and no entry in any list, and modules that are not needed are not
    imported.

    ``what`` is the name of the kind in messages, such as ``"vehicle"``. ``package`` and its ``__path__``
    contain the modules of the members. ``attribute`` of a member, if it is stated, is set to its name.
    ``contract`` has the classes that a member is derived from, or is an instance of, and the protocols whose
    attributes it has; they are checked when the member is registered.
    """

    def __init__(
        self,
        what: str,
        package: str,
        path: Iterable[str],
        attribute: str | None = None,
        contract: Iterable[type] = (),
    ) -> None:
        self.what, self.package = what, package
        self._path, self._attribute, self._contract = path, attribute, contract
        self._members: dict[str, Member] = {}
        self._is_complete = False

    def add(self, name: str) -> Callable[[Member], Member]:
        """Return a decorator that registers a class, function or object under a name.

        InputError is raised if another member already has the name, or if the member does not fulfil the
        contract.
        """
        if not isinstance(name, str) or not name:
            raise InputError(
                f"a new {self.what}",
                seen=f"{described(name)} as its name",
                expected="text",
                change='Register it with add("name").',
            )

        def register(member: Member) -> Member:
            if self._attribute is not None:
                with suppress(AttributeError, TypeError):  # of what is no member: the next line says so
                    setattr(member, self._attribute, name)
            self._require(name, member)
            extension = extensions.current()
            if extension is not None and not extension.is_checked:
                self._import_all()  # so that an extension cannot replace a member of the library
            if self._members.get(name, member) is not member:
                raise InputError(
                    f"{self.what} {name!r}",
                    seen="two members of this name",
                    expected="a name of its own for each member",
                    change="Rename one of them. If it is the same one, name its file in `modules`.",
                )
            guard(member if isinstance(member, type) else type(member), self._contract, f"{self.what} {name}")
            if extension is not None and name not in self._members:
                extension.members.append((self, name))
            self._members[name] = member
            return member

        return register

    def remove(self, name: str) -> None:
        """Remove a member."""
        del self._members[name]

    def __getitem__(self, name: str) -> Member:
        """Return the member with a name; raise InputError with the known names if there is none."""
        if name not in self:
            near = get_close_matches(str(name), self._members, n=1)
            raise InputError(
                self.what,
                seen=described(name),
                expected=f"one of {', '.join(self)}",
                change=f"Did you mean {near[0]}?" if near else "Name one of these.",
            )
        return self._members[name]

    def __contains__(self, name: object) -> bool:
        """Return whether there is a member with this name.

        The module of the same name is imported first, then the extensions. The other modules, which may be
        large, are imported only if the name is not found there.
        """
        if not isinstance(name, str):
            return False
        for step in (lambda: self._import_namesake(name), extensions.load_known, self._import_all):
            if name not in self._members:
                step()
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
        for module in pkgutil.walk_packages(self._path, f"{self.package}."):
            if module.name.rpartition(".")[2] == name:
                importlib.import_module(module.name)

    def _complete(self) -> None:
        """Import the extensions, and all modules of the package, once."""
        extensions.load_known()
        self._import_all()

    def _import_all(self) -> None:
        """Import all modules of the package, once."""
        if not self._is_complete:
            self._is_complete = True  # set first, because a module may look up a member while it is imported
            for module in pkgutil.walk_packages(self._path, f"{self.package}."):
                importlib.import_module(module.name)

    def _require(self, name: str, member: Member) -> None:
        """Raise InputError if a member does not fulfil the contract."""
        for missing in filter(None, (missing_of(member, contract) for contract in self._contract)):
            raise InputError(
                f"{self.what} {name!r}",
                seen=missing[0],
                expected=missing[1],
                change="Correct it; docs/extensions.md shows a file of each kind.",
            )


def missing_of(member: object, contract: type) -> tuple[str, str] | None:
    """Return what was found in a member, and what a contract expects instead; None if it is fulfilled.

    A contract is a class from which the member is derived, or of which it is an instance, and whose abstract
    methods and class attributes without a value it defines; or a protocol, whose attributes it has.
    """
    is_class = isinstance(member, type)
    named = f"the {'class' if is_class else type(member).__name__} {getattr(member, '__name__', member)!s}"
    whole = f"{contract.__module__}.{contract.__qualname__}"
    if getattr(contract, "_is_protocol", False):
        needed = {name for base in contract.__mro__ for name in (*vars(base), *_annotated(base))}
    elif issubclass(member, contract) if isinstance(member, type) else isinstance(member, contract):
        declared = [(name, kind) for base in contract.__mro__ for name, kind in _annotated(base).items()]
        needed = {*getattr(member, "__abstractmethods__", ())}
        needed |= {name for name, kind in declared if "ClassVar" in str(kind)} if is_class else set()
    else:
        return named, f"{'a class that derives from' if is_class else 'an instance of'} {whole}"
    present = {field.name for field in fields(member)} if is_dataclass(member) else set()
    present |= {name for name in dir(member) if not getattr(getattr(member, name, None), ABSTRACT, False)}
    lacking = sorted(name for name in needed - present if not name.startswith("_"))
    return (f"{named} without {', '.join(lacking)}", f"all attributes of {whole}") if lacking else None


def _annotated(kind: type) -> Mapping[str, Any]:
    """Return the annotations of a class, without those of its bases."""
    return vars(kind).get("__annotations__", {})
