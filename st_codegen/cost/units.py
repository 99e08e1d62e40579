"""The worst case of every unit of a project: bodies, calls, loops."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

from st_codegen.cost import rounds
from st_codegen.cost.access import Accesses, PathState
from st_codegen.cost.memory import Loop, Region, Touch, Touches, new_version
from st_codegen.cost.operations import CostClass, size_of
from st_codegen.cost.paths import CodeLines, CodeOf, Costs, Flow, Outcomes, PathCost, at_site
from st_codegen.cost.profile import Profile
from st_codegen.cost.ranges import Interval
from st_codegen.st import tree as t
from st_codegen.st import walk
from st_codegen.st.check.flow import overriding
from st_codegen.st.tree import PouKind


@dataclass(frozen=True, eq=False)
class UnitCost:
    """The worst call of a unit, with all that it calls.

    `code_bytes` is an estimate of all its code, each operation counted once as it stands in the text. `unbounded` says
    which loops have no known bound, here and in what it calls, and which blocks of libraries no known time; those are
    counted once.
    """

    cost: PathCost
    code_bytes: int
    unbounded: tuple[str, ...]
    called: frozenset[str]


class Units:
    """The costs of a project's units, each computed once; paths are compared by their cycles with cold caches."""

    def __init__(self, project: t.Project, profile: Profile) -> None:
        self.project = project
        self.weights = profile.weights(is_cold=True)
        self.code_bytes = profile.machine["code_bytes"]
        self._done: dict[str, UnitCost] = {}

    def of(self, key: str) -> UnitCost:
        """The cost of a unit by its key; projects have no recursion."""
        if key not in self._done:
            pou = self.project.pous[key]
            is_block = pou.block is not None or pou.kind is PouKind.FUNCTION_BLOCK
            unknown = (f"{pou.full_name}: a block of a library, whose time is not known",) if is_block else ()
            native = UnitCost(Costs(key, self.weights).of(CostClass.NATIVE), 0, unknown, frozenset())
            self._done[key] = native if pou.is_native else _Body(self, pou).cost()
        return self._done[key]


class _Body:
    """Walks the body of one unit and adds up what it costs."""

    def __init__(self, units: Units, pou: t.Pou) -> None:
        self._units = units
        self._pou = pou
        self._costs = Costs(pou.key, units.weights)
        self._code = 0.0  # bytes so far, in the order of the text
        self._unbounded: dict[str, None] = {}
        self._called: set[str] = set()
        self._accesses = Accesses(units.project, pou, self._costs, self._call)
        self._state = PathState()

    def cost(self) -> UnitCost:
        """The worst case of a call of the unit."""
        outcomes = self._body(self._pou.body)
        worst = self._costs.worse(outcomes.get(Flow.NEXT), outcomes.get(Flow.RETURN)) or PathCost()
        cost = self._own_memory().then(worst)
        return UnitCost(cost, int(self._code), tuple(self._unbounded), frozenset(self._called))

    def _own_memory(self) -> PathCost:
        """The memory that the scalars of the instance, or of the call, lie in."""
        own = (item for item in self._pou.variables if not item.is_constant and item.storage is not t.Storage.GLOBAL)
        sizes = (size_of(variable.type, self._units.project.pous) for variable in own)
        size = sum(size for size in sizes if size <= 8)
        if not size:
            return PathCost()
        is_shared = self._pou.kind is not PouKind.FUNCTION_BLOCK
        region = Region((), f"{self._pou.key} variables", self._pou.key, size, is_shared)
        return PathCost({}, {region: Touch(region, span=size, executions=region.lines)})

    def _body(self, body: tuple[t.Statement, ...]) -> Outcomes:
        return self._costs.sequence(partial(self._statement, statement) for statement in body)

    # --- statements ---

    def _statement(self, statement: t.Statement) -> Outcomes:  # noqa: PLR0911 - one return a case
        match statement:
            case t.Assign():
                return {Flow.NEXT: self._assign(statement)}
            case t.CallStatement(call=call):
                return {Flow.NEXT: self._value(call)}
            case t.If():
                return self._if(statement)
            case t.Case():
                return self._case(statement)
            case t.For():
                return self._for(statement)
            case t.While() | t.Repeat():
                return self._while(statement)
            case t.Exit():
                return {Flow.EXIT: PathCost()}
            case t.Continue():
                return {Flow.CONTINUE: PathCost()}
            case t.Return():
                return {Flow.RETURN: PathCost()}
            case _:
                raise TypeError(statement)

    def _count(self, cost: PathCost) -> PathCost:
        """The cost of a piece of text, which is the next piece of the unit's code."""
        own = cost.counts.get(self._pou.key)
        return cost if own is None else cost.then(self._next_code(int(own.sum()) * self._units.code_bytes))

    def _next_code(self, size: float) -> PathCost:
        start, self._code = self._code, self._code + size
        return PathCost(code={self._pou.key: CodeLines.between(int(start), math.ceil(self._code))})

    def _one(self, *operations: CostClass) -> PathCost:
        return self._count(self._costs.of(*operations))

    def _value(self, node: t.Expression) -> PathCost:
        cost = self._count(self._accesses.value(node, self._state))
        # a number in the text stands beside the code that loads it
        numbers = sum(isinstance(part, t.Constant) and part.type.is_real for part in walk.expressions(node))
        return cost.then(self._next_code(8 * numbers)) if numbers else cost

    def _test(self, condition: t.Expression) -> PathCost:
        return self._value(condition).then(self._one(CostClass.BRANCH))

    def _assign(self, statement: t.Assign) -> PathCost:
        cost = self._value(statement.value)
        cost = cost.then(self._count(self._accesses.store(statement.target, self._state)))
        self._state.assigned(statement.target, self._state.ranges.of(statement.value))
        return cost

    def _choose(self, tests: list[PathCost], statement: t.If | t.Case) -> Outcomes:
        """The worst branch, each behind its tests.

        Every branch starts from the same state; afterwards the state is what all that go on have in common.
        """
        before, after, ways = self._state, [], []
        for test, body in zip(tests, walk.bodies(statement), strict=True):
            self._state = before.copy()
            way = self._body(body)
            ways.append({flow: test.then(cost) for flow, cost in way.items()})
            if Flow.NEXT in way:
                after.append(self._state)
        self._state = before
        self._state.become_common(after)
        return self._costs.choose(ways)

    def _if(self, statement: t.If) -> Outcomes:
        tests, before = PathCost(), []
        for branch in statement.branches:
            tests = tests.then(self._test(branch.condition))
            before.append(tests)
        return self._choose([*before, tests], statement)

    def _case(self, statement: t.Case) -> Outcomes:
        """Labels are tried one after the other, as a chain of comparisons."""
        tests, before = self._value(statement.selector), []
        for branch in statement.branches:
            for low, high in branch.labels:
                compares = [CostClass.COMPARE] * (1 if low == high else 2)
                tests = tests.then(self._one(*compares, CostClass.BRANCH))
            before.append(tests)
        return self._choose([*before, tests], statement)

    # --- loops ---

    def _for(self, statement: t.For) -> Outcomes:
        count = rounds.of_for(statement, self._state.ranges)
        start, stop, step = (self._state.ranges.of(node) for node in (statement.start, statement.stop, statement.step))
        before = self._value(statement.start).then(self._value(statement.stop)).then(self._one(CostClass.STORE))
        if not isinstance(statement.step, t.Constant):
            before = before.then(self._value(statement.step))
        counter = statement.variable
        begin, each = self._code, self._one(CostClass.LOOP)
        first = new_version()
        self._enter(statement.body, {counter})
        moving = self._state.versions.change(counter)
        if start is not None and stop is not None:
            self._state.ranges.set(counter, start.hull(stop))
        body = self._body(statement.body)
        largest = 1 if step is None else max(abs(step.low), abs(step.high))
        loop = Loop(first, moving, largest, start is not None and start.low == start.high)
        result = self._loop(statement, count, body, each=each, loop=loop, begin=begin)
        self._enter(statement.body, {counter})
        if start is not None and stop is not None and step is not None:
            beyond = Interval(stop.low + min(step.low, 0), stop.high + max(step.high, 0))
            self._state.ranges.set(counter, start.hull(beyond))
        return {flow: before.then(cost) for flow, cost in result.items()}

    def _while(self, statement: t.While | t.Repeat) -> Outcomes:
        is_repeat = isinstance(statement, t.Repeat)
        count = rounds.of_condition(statement.condition, statement.body, self._state.ranges, is_negated=is_repeat)
        if count is not None and is_repeat:
            count = max(count, 1)
        begin, first = self._code, new_version()
        self._enter(statement.body, set())
        if is_repeat:
            ways, each = self._body(statement.body), PathCost()
            test = self._test(statement.condition)
            body: Outcomes = {flow: cost for flow, cost in ways.items() if flow in (Flow.EXIT, Flow.RETURN)}
            onward = self._costs.worst(ways.get(flow) for flow in (Flow.NEXT, Flow.CONTINUE))
            if onward is not None:
                body[Flow.NEXT] = onward.then(test)
        else:
            each = self._test(statement.condition)
            body = self._body(statement.body)
        result = self._loop(statement, count, body, each=each, loop=Loop(first), begin=begin)
        self._enter(statement.body, set())
        return result

    def _enter(self, body: tuple[t.Statement, ...], also: set[t.Variable]) -> None:
        """Nothing is known of what a loop assigns, at its start and behind it."""
        changed = walk.assigned_variables(body) | also
        for variable in changed:
            self._state.versions.change(variable)
        self._state.ranges.forget(changed)
        self._state.after_calls(body)

    def _loop(
        self,
        statement: t.For | t.While | t.Repeat,
        count: int | None,
        body: Outcomes,
        *,
        each: PathCost,
        loop: Loop,
        begin: float,
    ) -> Outcomes:
        """Every way out of a loop with all its rounds; a loop without a known bound is noted and counted once.

        `begin`: where its code begins.
        """
        if count is None:
            kind = type(statement).__name__.upper()
            self._unbounded[f"{self._pou.name}, {statement.position}: no bound known for the rounds of this {kind}"] = (
                None
            )
        number = 1 if count is None else count

        def spread(cost: PathCost) -> PathCost:
            touches = {key: touch.repeated(max(number, 1), loop) for key, touch in cost.touches.items()}
            code = self._all_code(cost, begin) if count is None or number > 1 else cost.code
            return PathCost(cost.counts, touches, code, cost.called)

        spread_body = {flow: spread(cost) for flow, cost in body.items()}
        found = self._costs.loop(number, spread_body, each=spread(each))
        # no choice is left: another round may take the other branch
        return {flow: replace(cost, choices=()) for flow, cost in found.items()}

    def _all_code(self, cost: PathCost, begin: float) -> dict[str, CodeLines]:
        """The code of a loop, whose rounds may go all ways: its own from `begin` on, all of the units that it calls."""
        keys = cost.code.keys() - {self._pou.key}
        called = {unit: CodeLines.between(0, self._units.of(unit).code_bytes) for unit in keys}
        return called | {self._pou.key: CodeLines.between(int(begin), math.ceil(self._code))}

    # --- calls ---

    def _call(self, call: t.Call, path: tuple[str, ...], state: PathState) -> PathCost:
        """The body behind a call, the worst where it is virtual; arguments are the caller's affair."""
        keys = {call.callee} | (overriding(self._units.project, call.callee) if call.is_virtual else set())
        worst: PathCost | None = None
        for key in sorted(keys):
            unit = self._units.of(key)
            self._called.add(key)
            self._called.update(unit.called)
            self._unbounded.update(dict.fromkeys(unit.unbounded))
            site = new_version()
            touches: Touches = {(site, name): touch.called(path) for name, touch in unit.cost.touches.items()}
            called = at_site(site, {*unit.cost.touches, *unit.cost.called, CodeOf(key)})
            choices = tuple((at_site(site, one), at_site(site, other)) for one, other in unit.cost.choices)
            worst = self._costs.worse(worst, PathCost(unit.cost.counts, touches, unit.cost.code, called, choices))
        state.after_call(call)
        return worst or PathCost()
