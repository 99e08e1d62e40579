"""Where values live in the code for lanes: slots, elements, fields, references, and the loads and stores of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from st_codegen.st import tree as t
from st_codegen.st.errors import Position, Problem, StCheckError
from st_codegen.st.run.emit import Writer, is_inlined, literal
from st_codegen.st.types import ArrayType, Elementary, EnumType, PointerType, StructType, Type, storage_type

if TYPE_CHECKING:
    from st_codegen.st.run.lane_code import LaneCode


def is_elementary(type_: Type) -> bool:
    """Whether values of a type are single values in Python, too."""
    return isinstance(type_, Elementary | EnumType | PointerType)


@dataclass(frozen=True)
class Resolved:
    """The index of each list element of a path, by its id, in the code that follows.

    With `positions` that code runs for a part of the lanes in `before`: those at these positions.
    """

    indices: dict[int, str]
    positions: str | None = None
    before: str = "m"


class Places(Writer):
    """Writes code that reads and assigns places.

    Values are atoms: names of temporaries or literals. `memo` maps what was computed already to its temporary, as long
    as the active lanes and the variables it was loaded from stay the same.
    """

    def __init__(self, compiler: LaneCode, pou: t.Pou, boxed: set[t.Variable]) -> None:
        super().__init__(compiler.source)
        self.compiler = compiler
        self.pou = pou
        self.boxed = boxed
        self.memo: dict[tuple[object, ...], str] = {}
        self.aliases: set[str] = set()
        self.counters: dict[t.Variable, str] = {}
        self.is_unstable = False

    def expression(self, expression: t.Expression) -> str:
        """The atom of an expression."""
        raise NotImplementedError

    # --- temporaries ---

    def temporary(self, code: str, position: Position, key: tuple[object, ...] | None = None) -> str:
        """A temporary for a piece of code, or the one that has its value already."""
        if key is not None and key in self.memo:
            return self.memo[key]
        name = self.fresh()
        self.line(f"{name} = {code}", position)
        if key is not None:
            self.memo[key] = name
        return name

    def load(self, code: str, position: Position, root: t.Variable | None, is_alias: bool) -> str:
        """A temporary for a load; kept while its root variable is not assigned."""
        if self.is_unstable and is_alias:
            return self.temporary(f"own({code})", position)
        is_kept = root is not None and root.section is not t.Section.IN_OUT and not self.is_unstable
        name = self.temporary(code, position, ("load", root, code) if is_kept else None)
        if is_alias:
            self.aliases.add(name)
        return name

    def forget(self, root: t.Variable | None) -> None:
        """Drop loads that an assignment may have made stale; without a root variable, all of them."""
        if root is not None and root.section is t.Section.IN_OUT:
            root = None
        self.memo = {key: name for key, name in self.memo.items() if key[0] != "load" or root not in (None, key[1])}

    def owned(self, atom: str) -> str:
        """Code for a value that no variable holds."""
        return f"own({atom})" if atom in self.aliases else atom

    def dtype(self, type_: Type) -> str:
        """The name of the dtype that stores a type."""
        dtype = np.dtype(object) if isinstance(type_, PointerType) else storage_type(type_).dtype
        return self.source.register("D_", ("dtype", dtype), lambda: dtype)

    # --- objects: structures, blocks, arrays, unions ---

    def variable_slot(self, variable: t.Variable) -> str:
        """Where a variable is, as Python source that can be assigned."""
        match variable.storage:
            case t.Storage.INSTANCE:
                return f"s.v_{variable.key}"
            case t.Storage.GLOBAL:
                return f"rt.g.v_{variable.owner}__{variable.key}"
        if variable.is_constant:
            return self.compiler.constant_object(variable)
        return f"v_{variable.key}.v" if variable in self.boxed else f"v_{variable.key}"

    def object(self, place: t.Expression, indices: dict[int, str]) -> str:  # noqa: PLR0911 - one return a case
        """The object that a place of a composite type is; `indices` has the index of lists on the way."""
        match place:
            case t.VariableRef():
                return self.variable_slot(place.variable)
            case t.ThisRef():
                return "s"
            case t.ProgramRef():
                return f"rt.p_{str(place.type).upper()}"
            case t.InstanceVariable():
                return f"{self.object(place.base, indices)}.v_{place.variable.key}"
            case t.FieldRef():
                return f"{self.object(place.base, indices)}.v_{place.name}"
            case t.ElementRef():
                return f"{self.object(place.base, indices)}[{indices[id(place)]}]"
            case t.Call():
                return self.expression(place)
            case _:
                raise refusal(place)

    def list_elements(self, place: t.Expression) -> list[t.ElementRef]:
        """The elements on a path that are composite themselves: which one must be the same in all active lanes."""
        found: list[t.ElementRef] = []
        current: t.Expression | None = place
        while isinstance(current, t.FieldRef | t.InstanceVariable | t.ElementRef):
            if isinstance(current, t.ElementRef) and not is_elementary(current.type):
                found.append(current)
            current = current.base
        return found

    @contextmanager
    def resolved(self, places: list[t.Expression]) -> Iterator[Resolved]:
        """Code below runs once for each combination of list indices that the active lanes have.

        Without lists, or with constant indices, nothing is written.
        """
        elements = [element for place in places for element in self.list_elements(place)]
        atoms = [self.index(element) for element in elements]
        if all(atom.isdecimal() for atom in atoms):
            yield Resolved({id(element): atom for element, atom in zip(elements, atoms, strict=True)})
            return
        before, positions = self.fresh("m"), self.fresh("q")
        names = [self.fresh("k") for _ in atoms]
        self.line(f"{before} = m")
        saved = self.memo
        self.memo = {}
        with self.indented(
            f"for m, {positions}, ({', '.join(names)},) in parts({before}, ({', '.join(atoms)},), rt.lanes):"
        ):
            yield Resolved({id(item): name for item, name in zip(elements, names, strict=True)}, positions, before)
        self.line(f"m = {before}")
        self.memo = saved

    def index(self, element: t.ElementRef) -> str:
        """The atom of a checked flat index."""
        bounds = cast(ArrayType, element.base.type).bounds
        total: str | None = None
        for item, (low, high) in zip(element.indices, bounds, strict=True):
            size = high - low + 1
            if isinstance(item, t.Constant):
                part = str(cast(int, item.value) - low)
            else:
                atom = self.expression(item)
                part = self.temporary(f"ix({atom}, {low}, {size})", item.position, ("ix", atom, low, size))
            if total is None:
                total = part
            elif total.isdecimal() and part.isdecimal():
                total = str(int(total) * size + int(part))
            else:
                total = self.temporary(f"{total} * {size} + {part}", item.position, ("flat", total, size, part))
        return total or "0"

    # --- reading and assigning elementary places ---

    def read(self, place: t.Expression) -> str:
        """The atom of an elementary place."""
        if isinstance(place, t.VariableRef):
            return self.read_variable(place)
        if isinstance(place, t.InstanceVariable) and is_inlined(place.variable):
            return literal(cast(int, place.variable.initial))
        if not self.list_elements(place):
            return self._leaf(place, {})
        result, dtype = self.fresh("z"), self.dtype(place.type)
        self.line(f"{result} = None")
        with self.resolved([place]) as path:
            value = self.owned(self._leaf(place, path.indices))
            if path.positions is None:
                self.line(f"{result} = {value}")
            else:
                self.line(f"{result} = gather({result}, {path.positions}, {value}, {path.before}, rt.lanes, {dtype})")
        return result

    def read_variable(self, place: t.VariableRef) -> str:
        """The atom of an elementary variable."""
        variable, where = place.variable, place.position
        if is_inlined(variable):
            return literal(cast(int, variable.initial))
        if variable in self.counters:
            return self.load(f"ld({self.counters[variable]}, m)", where, variable, is_alias=True)
        slot = self.variable_slot(variable)
        code = f"{slot}.get(m)" if variable.section is t.Section.IN_OUT else f"ld({slot}, m)"
        return self.load(code, where, variable, is_alias=True)

    def _leaf(self, place: t.Expression, indices: dict[int, str]) -> str:
        where, root = place.position, stable_root(place)
        match place:
            case t.ElementRef() if is_union_field(place.base):
                owner, number = self._union(cast(t.FieldRef, place.base), indices)
                return self.load(f"{owner}.get({number}, {self.index(place)}, m)", where, root, is_alias=False)
            case t.ElementRef():
                constant = self.compiler.constant_table(place.base)
                k = self.index(place)
                if constant is not None:
                    return self.temporary(f"tab({constant}, {k})", where, ("tab", constant, k))
                return self.load(f"{self.object(place.base, indices)}.get({k}, m)", where, root, is_alias=True)
            case t.FieldRef() if is_union_field(place):
                owner, number = self._union(place, indices)
                return self.load(f"{owner}.get({number}, 0, m)", where, root, is_alias=False)
            case t.FieldRef() | t.InstanceVariable():
                return self.load(f"ld({self.object(place, indices)}, m)", where, root, is_alias=True)
            case _:
                raise refusal(place)

    def _union(self, place: t.FieldRef, indices: dict[int, str]) -> tuple[str, int]:
        fields = [entry.name.upper() for entry in cast(StructType, place.base.type).fields]
        return self.object(place.base, indices), fields.index(place.name)

    def store(self, place: t.Expression, atom: str) -> None:
        """Assign an elementary place."""
        if isinstance(place.type, PointerType):
            raise refusal(place)
        with self.resolved([place]) as path:
            value = atom if path.positions is None else f"pick({atom}, {path.positions})"
            self._store_leaf(
                place, path.indices, value, self.owned(atom) if path.positions is None else f"own({value})"
            )
        self.forget(stable_root(place))

    def _store_leaf(self, place: t.Expression, indices: dict[int, str], value: str, owned: str) -> None:
        where = place.position
        if isinstance(place, t.ElementRef):
            if is_union_field(place.base):
                owner, number = self._union(cast(t.FieldRef, place.base), indices)
                self.line(f"{owner}.set({number}, {self.index(place)}, {value}, m)", where)
            else:
                k = self.index(place)
                self.line(f"{self.object(place.base, indices)}.set({k}, {value}, m)", where)
        elif isinstance(place, t.FieldRef) and is_union_field(place):
            owner, number = self._union(place, indices)
            self.line(f"{owner}.set({number}, 0, {value}, m)", where)
        elif isinstance(place, t.VariableRef) and place.variable.section is t.Section.IN_OUT:
            self.line(f"{self.variable_slot(place.variable)}.set({owned}, m)", where)
        else:
            self.store_slot(self.object(place, indices), place.type, owned, where)

    def store_slot(self, slot: str, type_: Type, owned: str, position: Position) -> None:
        """Assign a slot of an elementary type."""
        self.line(f"{slot} = put({slot}, {owned}, m, rt.lanes, {self.dtype(type_)})", position)

    def reference(self, place: t.Expression, indices: dict[int, str]) -> str:
        """Code for what a VAR_IN_OUT parameter gets."""
        if not is_elementary(place.type):
            return self.object(place, indices)
        if isinstance(place, t.VariableRef) and place.variable.section is t.Section.IN_OUT:
            return self.variable_slot(place.variable)
        if isinstance(place, t.ElementRef) and is_union_field(place.base):
            owner, number = self._union(cast(t.FieldRef, place.base), indices)
            return f"UnionReference({owner}, {number}, {self.index(place)}, m)"
        if isinstance(place, t.ElementRef):
            k = self.index(place)
            return f"ElementReference({self.object(place.base, indices)}, {k}, m)"
        if isinstance(place, t.FieldRef) and is_union_field(place):
            owner, number = self._union(place, indices)
            return f"UnionReference({owner}, {number}, 0, m)"
        owner, _, name = self.object(place, indices).rpartition(".")
        return f"SlotReference({owner}, {name!r}, rt.lanes, {self.dtype(place.type)})"


def stable_root(place: t.Expression) -> t.Variable | None:
    """The variable whose assignment changes a place; None when the same memory has other names, too."""
    while isinstance(place, t.FieldRef | t.ElementRef | t.InstanceVariable):
        place = place.base
    return place.variable if isinstance(place, t.VariableRef) else None


def is_union_field(place: t.Expression) -> bool:
    """Whether a place is a field of a union."""
    return isinstance(place, t.FieldRef) and isinstance(place.base.type, StructType) and place.base.type.is_union


def refusal(place: t.Expression) -> StCheckError:
    """What the interpreter says to pointers."""
    message = "pointers and references are checked but not executed; only native blocks can take them"
    return StCheckError([Problem(place.position, message)])
