"""The exchange between slow and fast task: never a torn set, whatever the two do to each other; stale sets; programs.

Every statement of both blocks that touches the exchange variable is a point at which the other task may run, for as
many statements as it likes: the two are stepped through as threads that hand control to each other at these points.
Each coefficient is 64 bits, which x86 stores whole; so a statement is the smallest step.
"""

import threading

import numpy as np
import pytest

from st_codegen.st import Library, Machine, parse_project
from tests.te.hostile import pair
from tests.te.projects import (
    ORDERS,
    RATIO,
    coefficient,
    error_codes,
    loaded,
    loaded_with,
    parts,
    project,
    texts,
)

CODE = error_codes()
SLOPE = 1e-6
SETS = 4


class Turns:
    """Lets two threads run in turns: each pauses at every cut until it may go on."""

    def __init__(self):
        self.here = threading.local()
        self.renew()

    def renew(self):
        self.may_go = {"slow": threading.Semaphore(0), "fast": threading.Semaphore(0)}
        self.paused = threading.Semaphore(0)
        self.done = dict.fromkeys(self.may_go, False)
        self.errors = []

    def cut(self, call):
        """Called from the middle of a block."""
        name = getattr(self.here, "name", None)
        if name is not None:
            self.paused.release()
            self.may_go[name].acquire()

    def start(self, name, work):
        def body():
            self.here.name = name
            self.may_go[name].acquire()
            try:
                work()
            except BaseException as error:
                self.errors.append(error)
            self.done[name] = True
            self.paused.release()

        thread = threading.Thread(target=body, daemon=True)
        thread.start()
        return thread

    def step(self, name):
        """Let a thread run to its next cut; False when it is over."""
        if not self.done[name]:
            self.may_go[name].release()
            self.paused.acquire()
        return not self.done[name]


def with_cuts(text):
    """A cut before every statement that touches the exchange variable."""
    lines = []
    for line in text.splitlines():
        if "stExchange." in line and line.endswith(";") and "(*" not in line:
            lines.append("F_Cut();")
        lines.append(line)
    return "\n".join(lines)


def stepped_project(change=("", "")):
    """The text for TwinCAT with cuts in both blocks; `change` is a mutation of it. Gives project, library, turns."""
    turns = Turns()
    library = Library("Cuts", "FUNCTION F_Cut END_FUNCTION\n", functions={"F_Cut": turns.cut})
    files = {path: text for path, text in texts(project(slope=SLOPE), "twincat").items() if "/" in path}
    for path in ("POUs/FB_CompensatorSlow.TcPOU", "POUs/FB_CompensatorFast.TcPOU"):
        text = files[path]
        if change[0] and change[0] in text:
            text = text.replace(*change)
        files[path] = with_cuts(text)
        assert files[path].count("F_Cut") >= 12
    return parse_project(files, "twincat", [library]), library, turns


@pytest.fixture(scope="module")
def stepped():
    return stepped_project()


def torque(number):
    """The torque with which set `number` is computed: it tells the sets apart."""
    return 100.0 * number


def run_schedule(stepped, schedule):
    """Slow runs SETS times, fast once, in turns of `schedule`: (name, steps); then both to their end, fast first.

    Gives the number of the set in use, all its coefficients, and how many steps each made.
    """
    checked, library, turns = stepped
    machine = Machine(checked, libraries=[library])
    slow, fast, signals = machine.program("PRG_Slow"), machine.program("PRG_Fast"), machine.globals
    signals["GVL_Machine.fSpeed_rpm"], signals["GVL_Machine.fTemperature_C"] = 500.0, 30.0

    def write():
        for number in range(2, 2 + SETS):
            signals["GVL_Machine.fTorque_Nm"] = torque(number)
            slow()

    signals["GVL_Machine.fTorque_Nm"] = torque(1)
    slow()  # outside of the threads: no cuts; a first whole set is there
    turns.renew()
    threads = [turns.start("slow", write), turns.start("fast", fast)]
    steps = {"slow": 0, "fast": 0}
    for name, count in (*schedule, ("fast", 1000), ("slow", 1000)):
        for _ in range(count):
            if not turns.step(name):
                break
            steps[name] += 1
    for thread in threads:
        thread.join(600)
        assert not thread.is_alive()
    assert not turns.errors, turns.errors
    names = ("aCosineFw", "aSineFw", "aCosineBw", "aSineBw")
    used = np.concatenate([fast[f"fbFast.stUsed.{name}"] for name in names])
    return fast["fbFast.stUsed.nNumber"], used, steps, fast["fbFast.nTorn"]


def whole_set(number):
    """All coefficients of set `number`."""
    move = SLOPE * (500.0 + torque(number) + 30.0) if number else 0.0
    cosine, sine, cosine_back, sine_back = *parts(0), *parts(1)
    moved = [cosine + move, sine + move, cosine_back + move, sine_back + move]
    moved[1][0] = moved[3][0] = 0.0  # the mean has no sine part
    return np.concatenate(moved) if number else np.zeros(12)


def is_torn(number, used):
    assert np.min(np.abs(whole_set(1) - whole_set(2))[np.abs(whole_set(1)) > 0]) > 1e-5
    return not np.allclose(used, whole_set(number), rtol=0.0, atol=1e-12)


def test_the_sets_are_what_they_are_taken_for(stepped):
    number, used, steps, torn = run_schedule(stepped, [])
    assert (number, torn) == (1, 0)
    assert used[0] == pytest.approx(coefficient(0) + SLOPE * 630.0)
    assert not is_torn(number, used)
    assert steps["fast"] >= 15
    assert steps["slow"] >= 15 * SETS


def test_no_torn_set_is_used_wherever_the_slow_task_cuts_in(stepped):
    """The fast task stops at each of its statements, the slow one goes on for any number of its own (in threes)."""
    _, _, steps, _ = run_schedule(stepped, [])
    seen, discarded = set(), 0
    for stop in range(steps["fast"] + 1):
        for count in range(0, steps["slow"] + 1, 3):
            number, used, _, torn = run_schedule(stepped, [("fast", stop), ("slow", count)])
            assert not is_torn(number, used), (stop, count)
            assert 0 <= torn <= 1
            discarded += torn
            seen.add(number)
    assert discarded > 20  # the case does occur
    assert seen >= {0, 1, 2, 3}


def test_no_torn_set_is_used_wherever_the_fast_task_cuts_in(stepped):
    """One core: the slow task is stopped at each of its statements by a whole run of the fast one."""
    _, _, steps, _ = run_schedule(stepped, [])
    for stop in range(steps["slow"] + 1):
        number, used, _, torn = run_schedule(stepped, [("slow", stop), ("fast", 1000)])
        assert torn == 0
        assert number >= 1
        assert not is_torn(number, used), stop


def random_schedule(random):
    """Turns of a few statements each, as on two cores of different speed."""
    pace = random.integers(1, 12, 2)
    return [(name, int(random.integers(0, pace[i] + 1))) for _ in range(30) for i, name in enumerate(("slow", "fast"))]


def test_no_torn_set_is_used_when_both_run_at_once(stepped):
    random = np.random.default_rng(11)
    for _ in range(80):
        schedule = random_schedule(random)
        number, used, _, _ = run_schedule(stepped, schedule)
        assert not is_torn(number, used), schedule


@pytest.mark.slow
def test_no_torn_set_is_used_in_any_of_many_schedules(stepped):
    random = np.random.default_rng(12)
    _, _, steps, _ = run_schedule(stepped, [])
    for before in range(40):
        for stop in range(steps["fast"] + 1):
            for _ in range(4):
                count = int(random.integers(0, steps["slow"]))
                schedule = [("slow", before), ("fast", stop), ("slow", count), *random_schedule(random)]
                number, used, _, _ = run_schedule(stepped, schedule)
                assert not is_torn(number, used), schedule


@pytest.mark.thorough
@pytest.mark.parametrize(
    "change",
    [
        ("IF stCopy.nNumber = nNewest THEN", "IF TRUE THEN"),
        # the number of the buffer last instead of first
        ("stExchange.stOdd.nNumber := nNumber;", ""),
    ],
)
def test_without_the_protocol_torn_sets_are_found(change):
    broken = stepped_project(change)
    random = np.random.default_rng(13)
    found = 0
    for _ in range(150):
        number, used, _, _ = run_schedule(broken, random_schedule(random))
        found += number == 0 or is_torn(number, used)
    assert found


@pytest.mark.parametrize("target", ["twincat", "iec"])
def test_a_slow_task_that_stops_lets_the_correction_fade_and_return(target):
    block = Machine(loaded_with(target, pair(target), slope=0.0)).instance("FB_Pair")
    point = {"fThetaOut_rad": 0.1, "fSpeed_rpm": 500.0, "fTorque_Nm": 10.0, "fTemperature_C": 30.0, "bEnable": True}
    block(**point, bSlow=False)
    assert block["eError"] == CODE["NOT_READY"]
    for _ in range(150):
        block(bSlow=True, fCycle_s=0.005)
    cosine, sine = parts(0)
    te = cosine @ np.cos(np.array([0, 1, 39]) * 0.1) - sine @ np.sin(np.array([0, 1, 39]) * 0.1)
    full = block["fCorrection_deg"]
    assert full == pytest.approx(-RATIO * te, rel=1e-9)
    values = [full]
    for cycle in range(110):
        block(bSlow=False)
        values.append(block["fCorrection_deg"])
        # four cycles of 5 ms are within the age limit of 20 ms
        assert block["eError"] == (CODE["NONE"] if cycle < 4 else CODE["STALE"])
    assert values[-1] == 0.0
    for _ in range(110):
        block(bSlow=True)
        values.append(block["fCorrection_deg"])
    assert values[-1] == pytest.approx(full, rel=1e-9)
    assert np.max(np.abs(np.diff(values))) <= abs(full) / 100 * (1 + 1e-6)


@pytest.mark.parametrize("target", ["twincat", "iec"])
def test_an_error_of_the_slow_task_reaches_the_fast_one(target):
    block = Machine(loaded_with(target, pair(target), slope=0.0)).instance("FB_Pair")
    block(bSlow=True, fThetaOut_rad=0.1, fSpeed_rpm=500.0, fTorque_Nm=np.nan, fTemperature_C=30.0)
    assert block["eError"] == CODE["OPERATING_POINT"]
    block(fTorque_Nm=1900.0)
    assert (block["eError"], block["bInRange"]) == (0, False)
    block(fTorque_Nm=100.0)
    assert (block["eError"], block["bInRange"], block["fAge_s"]) == (0, True, 0.0)


def test_numbers_of_sets_start_again_before_they_overflow():
    block = Machine(loaded_with("iec", pair("iec"), slope=0.0)).instance("FB_Pair")
    block["stExchange.nSequence"] = 999_999_999
    point = {"fThetaOut_rad": 0.1, "fSpeed_rpm": 500.0, "fTorque_Nm": 10.0, "fTemperature_C": 30.0}
    for number in (1_000_000_000, 1, 2, 3):
        block(bSlow=True, **point)
        assert block["stExchange.nSequence"] == number
        assert (block["fbFast.stUsed.nNumber"], block["fAge_s"], block["eError"]) == (number, 0.0, 0)


def drive(machine, cycles, call):
    """A motion through standstill and back by the signals of GVL_Machine; the corrections, one a cycle."""
    signals, theta, values = machine.globals, 0.0, []
    signals["GVL_Machine.bEnable"] = True
    for cycle in range(cycles):
        speed = 900.0 * np.cos(2 * np.pi * cycle / cycles)
        theta += speed / RATIO / 60.0 * 2 * np.pi * 0.0005
        signals["GVL_Machine.fThetaOut_rad"], signals["GVL_Machine.fSpeed_rpm"] = float(theta), float(speed)
        signals["GVL_Machine.fTorque_Nm"], signals["GVL_Machine.fTemperature_C"] = 400.0, 31.0
        call(cycle)
        values.append(signals["GVL_Machine.fCorrection_deg"])
        assert signals["GVL_Machine.bValid"]
    return np.array(values)


def test_prg_main_runs_through_thousands_of_cycles():
    machine = Machine(loaded("twincat", slope=0.0))
    program = machine.program("PRG_Main")
    values = drive(machine, 6000, lambda cycle: program())
    assert np.isfinite(values).all()
    assert np.max(np.abs(values)) > 1.0
    # what moves the correction in a cycle of 0.5 ms: the shaft, the ramp of 0.5 s, the blend of 0.1 s while the weight
    # is at most that of the speed after it, and the weight, whose speed changes by 900 * 2 * pi rpm in 6000 cycles
    size = [np.hypot(*parts(direction)) for direction in (0, 1)]
    shaft = 900.0 / RATIO / 60.0 * 2 * np.pi * 0.0005 * max(float(s @ np.array(ORDERS)) for s in size)
    te = max(float(s.sum()) for s in size)
    change = 900.0 * 2 * np.pi / 6000
    weight = (2.0 + 200 * change) / 100.0
    bound = RATIO * (shaft + te / 1000 + 2 * te / 200 * min(weight, 1.0) + te * change / 100)
    assert np.max(np.abs(np.diff(values))) <= bound
    assert bound < 1.0  # the slew limit allows this much


def test_both_programs_of_the_two_tasks_give_what_prg_main_gives():
    one = Machine(loaded("twincat", slope=0.0))
    main = one.program("PRG_Main")
    two = Machine(loaded("twincat", slope=0.0))
    slow, fast = two.program("PRG_Slow"), two.program("PRG_Fast")

    def both(cycle):
        slow()
        fast()
        fast()

    expected = drive(one, 2000, lambda cycle: main())
    got = drive(two, 2000, both)
    # two fast cycles of 0.25 ms for one of 0.5 ms: the ramps are the same at these moments
    assert np.max(np.abs(expected - got)) < 1e-9


def test_prg_main_of_the_portable_subset_has_ports():
    machine = Machine(loaded("iec", slope=0.0))
    program = machine.program("PRG_Main")
    program["bEnable"] = True
    for cycle in range(3000):
        program(fThetaOut_rad=cycle * 1e-3, fSpeed_rpm=900.0, fTorque_Nm=300.0, fTemperature_C=30.0)
        assert program["bValid"]
    assert program["fCorrection_deg"] != 0.0
