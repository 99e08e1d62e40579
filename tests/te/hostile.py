"""Sequences of arbitrary inputs for the blocks of the compensation, many at a time, and what must hold in each cycle.

Every row of the machine is a sequence of its own. In each cycle each input is either sensible or, with a probability
of the row, any 64 bits: NaN with any payload, infinities, denormals, huge numbers, -0.0, jumps, times that stand still
or run backwards. A floating point exception, an overflow, an index out of range or a loop beyond its bound stops the
interpreter. Run as `python -m tests.te.hostile` for 100,000 sequences and more.
"""

import re
import sys
import time
from dataclasses import dataclass
from functools import cache

import numpy as np

from st_codegen.st import Machine
from st_codegen.te.compensation.codes import EXPERIMENT_STATE
from st_codegen.te.harmonics import Direction
from tests.te.projects import BOTH, ORDERS, PLAY, RATIO, loaded_with, parts, project, texts

UNIT = 2.0**-53
LOOPS = 64  # rounds of one loop; the bundle has 3 orders, the model 3 inputs and 10 outputs

SPECIAL = np.array(
    [
        *(0.0, -0.0, 5e-324, -5e-324, 2.2e-308, -2.2e-308, 1.0, -1.0, 1e9, -1e9, np.nextafter(1e9, 2e9), 1e300, -1e300),
        *(1.7976931348623157e308, -1.7976931348623157e308, np.inf, -np.inf, np.nan, -np.nan, 1e-6, 1e-7, 360.0, 1e6),
        *(-1e6, np.pi, -np.pi, 2.0**31, -(2.0**31), 2.0**63, 4294967296.5),
    ]
)


def hostile(random, size):
    """Any 64 bits, with a liking for those at which something changes."""
    bits = random.integers(0, 2**64, size, dtype=np.uint64, endpoint=False).view(np.float64)
    with np.errstate(over="ignore"):
        near = np.nextafter(random.choice(SPECIAL, size), random.choice([-np.inf, np.inf], size))
    choice = random.integers(0, 4, size)
    return np.select([choice == 0, choice == 1], [bits, near], random.choice(SPECIAL, size))


@dataclass(frozen=True)
class Parameter:
    """An input with the range in which it is used; outside, the last usable value holds."""

    lower: float
    upper: float
    default: float


#: An input; its comment stands behind it, or above it where the line would be too long.
_INPUT = re.compile(r"(?:^    \(\*(.*)\*\)\n)?^    (\w+) : LREAL(?: := (.*?))?;(?: \(\*(.*)\*\))?$", re.MULTILINE)
_RANGE = re.compile(r"([-+\d.E]+) \.\. ([-+\d.E]+)$")

#: Ranges that the declaration does not tell.
_UNSTATED = {"fCycle_s": (1e-6, 1.0)}


@cache
def declared(block, play=None):
    """The LREAL inputs of a block as its text declares them; None for those without a default, which are signals."""
    (text,) = texts(project(play=play), "iec").values()
    section = re.search(rf"^FUNCTION_BLOCK {block}\n.*?^VAR_INPUT\n(.*?)^END_VAR", text, re.DOTALL | re.MULTILINE)[1]
    found = {}
    for above, name, default, behind in _INPUT.findall(section):
        stated = _RANGE.search((behind or above).strip())
        limits = stated.groups() if stated else _UNSTATED.get(name)
        assert limits or not default, f"{name} has a default and no range"
        found[name] = Parameter(*map(float, limits), float(default)) if default else None
    return found


def parameters_of(block, play=None):
    return {name: item for name, item in declared(block, play).items() if item is not None}


PAIR = """
FUNCTION_BLOCK FB_Pair
VAR_INPUT
    bSlow : BOOL; bEnable : BOOL; bPublishedLaw : BOOL; bLoadGiven : BOOL;
    {inputs}
END_VAR
VAR_OUTPUT
    fTE_deg : LREAL; fCorrection_deg : LREAL; fWeight : LREAL; bActive : BOOL; bValid : BOOL; bInRange : BOOL;
    fAge_s : LREAL; nTorn : DINT; eError : {error};
END_VAR
VAR
    stExchange : ST_TEExchange; fbSlow : FB_CompensatorSlow; fbFast : FB_CompensatorFast;
END_VAR
IF bSlow THEN
    fbSlow({slow}, stExchange := stExchange);
END_IF;
fbFast({fast}{load}, bEnable := bEnable, bPublishedLaw := bPublishedLaw, stExchange := stExchange);
fTE_deg := fbFast.fTE_deg;
fCorrection_deg := fbFast.fCorrection_deg;
fWeight := fbFast.fWeight;
bActive := fbFast.bActive;
bValid := fbFast.bValid;
bInRange := fbFast.bInRange;
fAge_s := fbFast.fAge_s;
nTorn := fbFast.nTorn;
eError := fbFast.eError;
END_FUNCTION_BLOCK
"""


@cache
def pair(target, play=None):
    """Both blocks of the two-task form around one exchange variable, with all inputs that either declares."""
    slow, fast = declared("FB_CompensatorSlow", play), declared("FB_CompensatorFast", play)
    inputs = [f"{name} : LREAL{f' := {item.default!r}' if item else ''};" for name, item in (slow | fast).items()]
    passed = (", ".join(f"{name} := {name}" for name in names) for names in (slow, fast))
    words = dict(zip(("slow", "fast"), passed, strict=True))
    words["load"] = ", bLoadGiven := bLoadGiven" if play else ""
    return PAIR.format(error="E_TEError" if target == "twincat" else "DINT", inputs=" ".join(inputs), **words)


def all_inputs(block, given, *others):
    """No input of a block is forgotten."""
    forgotten = {port.name for port in block.inputs} - given.keys() - set(others)
    assert not forgotten, forgotten


def finite(block, outputs):
    """All LREAL outputs are numbers."""
    for name in outputs:
        value = np.asarray(block[name])
        if value.dtype.kind == "f":
            assert np.isfinite(value).all(), (
                f"{name} is not finite in sequence {np.flatnonzero(~np.isfinite(value))[0]}"
            )


class Kept:
    """The usable values of parameters, as the description of the inputs says: the last one within its range."""

    def __init__(self, parameters, rows):
        self.parameters = parameters
        self.value = {name: np.full(rows, item.default) for name, item in parameters.items()}

    def see(self, given):
        for name, item in self.parameters.items():
            with np.errstate(invalid="ignore"):
                usable = (given[name] >= item.lower) & (given[name] <= item.upper)
            self.value[name] = np.where(usable, given[name], self.value[name])


class Sequences:
    """Inputs of FB_Compensator, or of both blocks of the two-task form, for many sequences.

    Three phases: anything; a bad input throughout with sensible parameters; good inputs.
    """

    ANYTHING, BAD, GOOD = 40, 40, 20

    def __init__(self, random, rows, parameters, backward_only=False, forward_only=False):
        self.random, self.rows, self.known = random, rows, parameters
        self.rate = random.choice([0.0, 0.02, 0.3, 1.0], rows)
        self.theta = random.uniform(-10, 10, rows) * 10.0 ** random.integers(0, 8, rows)
        self.speed = random.uniform(-1800, 1800, rows) * random.choice([0.0, 0.01, 1.0], rows)
        self.acceleration = random.normal(0, 300, rows) * random.choice([0.0, 1.0], rows)
        self.parameters = {name: self._parameter(name) for name in parameters}
        self.bad = random.integers(0, 4, rows)
        self.sign = -1.0 if backward_only else 1.0 if forward_only else None

    def _parameter(self, name):
        item, random, rows = self.known[name], self.random, self.rows
        typical = item.default * random.uniform(0.5, 2.0, rows)
        return np.where(random.random(rows) < 0.3, random.uniform(item.lower, item.upper, rows), typical)

    def _mixed(self, value):
        replaced = self.random.random(self.rows) < self.rate
        return np.where(replaced, hostile(self.random, self.rows), value)

    def sensible(self):
        random, rows = self.random, self.rows
        self.speed = self.speed + self.acceleration * 0.01
        self.theta = self.theta + self.speed / 81.0 / 60.0 * 2 * np.pi * 0.0005
        return {
            "fThetaOut_rad": self.theta,
            "fSpeed_rpm": self.speed,
            "fTorque_Nm": random.uniform(-100, 2000, rows),
            "fTemperature_C": random.uniform(20, 40, rows),
            **self._load(),
        }

    def _load(self):
        """For blocks that take it: a load of any sign, whatever the motion does."""
        if "fLoadTime_s" not in self.known:
            return {}
        return {"fSignedLoad": self.random.normal(0, 500, self.rows), "bLoadGiven": self.random.random(self.rows) < 0.7}

    def anything(self):
        given = self.sensible() | self.parameters
        given |= {name: self._mixed(value) for name, value in given.items() if name != "bLoadGiven"}
        given["bEnable"] = self.random.random(self.rows) < 0.9
        given["bPublishedLaw"] = self.random.random(self.rows) < 0.3
        return given

    def settled(self):
        """Parameters with which 40 cycles are enough to reach zero: 0.02 s each, 0.4 s of ramp, 0.18 s of slewing."""
        fixed = {"fCycle_s": 0.02, "fCorrectionLimit_deg": 30.0, "fSlewLimit_deg_s": 2000.0, "fRampTime_s": 0.4}
        fixed |= {"fHysteresis_rpm": 2.0, "fBlendTime_s": 0.1, "fLead_s": 0.0}
        fixed = {name: item.default for name, item in self.known.items()} | fixed
        given = self.sensible() | {name: np.full(self.rows, value) for name, value in fixed.items()}
        return given | {"bEnable": np.ones(self.rows, bool), "bPublishedLaw": np.zeros(self.rows, bool)}

    def faulty(self):
        given = self.settled()
        wrong = np.array([np.nan, np.inf, -np.inf, 1e12])[self.random.integers(0, 4, self.rows)]
        for number, name in enumerate(("fThetaOut_rad", "fSpeed_rpm", "fTorque_Nm", "fTemperature_C")):
            given[name] = np.where(self.bad == number, wrong, given[name])
        return given

    def good(self):
        given = self.settled()
        speed = np.clip(given["fSpeed_rpm"], -1800, 1800)
        speed = np.where(np.isfinite(speed), speed, 500.0)
        given["fSpeed_rpm"] = speed if self.sign is None else self.sign * (np.abs(speed) + 5.0)
        return given


def run_compensator(target, rows, seed, *, directions=BOTH, two_tasks=False, play=None):
    """Sequences through FB_Compensator or the pair of the two-task form; raises AssertionError or StRuntimeError."""
    random = np.random.default_rng(seed)
    one = None if len(directions) == 2 else directions[0]
    parameters = parameters_of("FB_Compensator", play)
    sequences = Sequences(random, rows, parameters, one is Direction.BACKWARD, one is Direction.FORWARD)
    project = loaded_with(target, pair(target, play), directions=directions, play=play)
    machine = Machine(project, rows=rows, loop_limit=LOOPS)
    block = machine.instance("FB_Pair" if two_tasks else "FB_Compensator")
    outputs = [port.name for port in block.outputs]
    kept, before = Kept(parameters, rows), np.zeros(rows)
    fading = np.zeros(rows, bool)
    age_limit = Kept({"fAgeLimit_s": declared("FB_CompensatorFast")["fAgeLimit_s"]}, rows)
    phases = [sequences.anything] * sequences.ANYTHING + [sequences.faulty] * sequences.BAD
    phases += [sequences.good] * sequences.GOOD
    for cycle, phase in enumerate(phases):
        given = phase()
        kept.see(given)
        if two_tasks:
            _disturb(block, random, rows, cycle < sequences.ANYTHING)
        all_inputs(block, given, *(["bSlow", "fAgeLimit_s", "bLoadGiven"] if two_tasks else []))
        block(**given)
        finite(block, outputs)
        correction = block["fCorrection_deg"]
        step = kept.value["fSlewLimit_deg_s"] * kept.value["fCycle_s"]
        change = np.abs(correction - before)
        # c + step and c - step are rounded once
        assert np.all(change <= step + UNIT * (np.abs(correction) + np.abs(before) + step)), cycle
        limit = np.maximum(kept.value["fCorrectionLimit_deg"], np.abs(before) - step)
        assert np.all(np.abs(correction) <= limit * (1 + 2 * UNIT)), cycle
        assert np.all((block["fWeight"] >= 0.0) & (block["fWeight"] <= 1.0))
        assert np.array_equal(block["bValid"], block["eError"] == 0)
        assert np.all(block["bActive"] | (correction == 0.0)), "who waits for bActive finds a correction"
        # behind an error only towards zero, until zero is reached
        fading = (fading & (before != 0.0)) | ~np.asarray(block["bValid"])
        assert np.all(~fading | ((np.abs(correction) <= np.abs(before)) & (correction * before >= 0.0))), cycle
        if two_tasks:
            age_limit.see({"fAgeLimit_s": block["fAgeLimit_s"]})
            assert not np.any(block["bValid"] & (block["fAge_s"] > age_limit.value["fAgeLimit_s"])), cycle
        if cycle == sequences.ANYTHING + sequences.BAD - 1:
            assert not np.any(correction), "not faded out"
            assert not np.any(block["bValid"])
            assert not np.any(block["bActive"])
        back = cycle - sequences.ANYTHING - sequences.BAD + 1
        if back > 0:
            # comes back with the ramp: 0.02 s of 0.4 s a cycle
            assert np.all(np.abs(correction) <= 30.0 * back * 0.05 * (1 + 4 * back * UNIT)), back
            assert np.all(block["bValid"])
            assert np.all(block["bActive"])
        before = correction.copy()
    return rows * len(phases)


def _disturb(block, random, rows, anything):
    """The slow task comes or does not; in the first phase somebody may write anything into the exchange variable."""
    block["bSlow"] = random.random(rows) < 0.7 if anything else True
    if not anything:
        block["fAgeLimit_s"] = 0.02
        return
    block["fAgeLimit_s"] = np.where(random.random(rows) < 0.1, hostile(random, rows), 0.02)
    if random.random() < 0.3:
        buffer = random.choice(["stOdd", "stEven"])
        name = random.choice(["aCosineFw", "aSineFw", "aCosineBw", "aSineBw"])
        old = np.asarray(block[f"stExchange.{buffer}.{name}"])
        wrong = hostile(random, old.size).reshape(old.shape)
        block[f"stExchange.{buffer}.{name}"] = np.where(random.random(old.shape) < 0.3, wrong, old)
        numbers = random.integers(-(2**30), 2**30, rows) * 2 + (buffer == "stOdd")
        chosen = random.random(rows) < 0.3
        for path in ("stExchange.nSequence", f"stExchange.{buffer}.nNumber"):
            block[path] = np.where(chosen, numbers, np.asarray(block[path])).astype(np.int32)


LOAD_PARAMETERS = parameters_of("FB_LoadTorque")


def run_load_torque(target, rows, seed, cycles=60):
    """Sequences through FB_LoadTorque: anything, then nothing but bad torques until it is at zero."""
    random = np.random.default_rng(seed)
    block = Machine(loaded_with(target, pair(target)), rows=rows, loop_limit=LOOPS).instance("FB_LoadTorque")
    kept, before = Kept(LOAD_PARAMETERS, rows), np.zeros(rows)
    rate = random.choice([0.0, 0.1, 1.0], rows)
    for cycle in range(cycles):
        typical = {name: item.default * random.uniform(0.5, 1.0, rows) for name, item in LOAD_PARAMETERS.items()}
        typical["fTorque_Nm"] = random.uniform(-2500, 2500, rows)
        given = {n: np.where(random.random(rows) < rate, hostile(random, rows), v) for n, v in typical.items()}
        if cycle >= cycles - 5:
            fixed = {"fCycle_s": 1.0, "fTorqueLimit_Nm": 2000.0, "fRate_Nm_s": 500.0, "fTorque_Nm": np.nan}
            given = {name: np.full(rows, value) for name, value in fixed.items()}
        kept.see(given)
        all_inputs(block, given, "bEnable")
        block(bEnable=random.random(rows) < 0.9, **given)
        finite(block, [port.name for port in block.outputs])
        torque = block["fShaftTorque_Nm"]
        step = kept.value["fRate_Nm_s"] * kept.value["fCycle_s"]
        assert np.all(np.abs(torque - before) <= step + UNIT * (np.abs(torque) + np.abs(before) + step)), cycle
        limit = np.maximum(kept.value["fTorqueLimit_Nm"], np.abs(before) - step)
        assert np.all(np.abs(torque) <= limit * (1 + 2 * UNIT)), cycle
        assert np.all(np.abs(block["fMotorTorque_Nm"] - torque / 156.0) <= UNIT * np.abs(torque))
        before = torque.copy()
    assert not np.any(before), "not at zero"
    return rows * cycles


def run_experiment(target, rows, seed, cycles=60):
    """Sequences through FB_Experiment that start in any step; at the end an abort must bring the speed to zero."""
    random = np.random.default_rng(seed)
    block = Machine(loaded_with(target, pair(target)), rows=rows, loop_limit=LOOPS).instance("FB_Experiment")
    states = {code.name: code.value for code in EXPERIMENT_STATE.all}
    measuring = [states["WAIT_ZERO"], states["MEASURE"]]
    rate = random.choice([0.0, 0.02, 0.2, 1.0], rows)
    names = [port.name for port in block.inputs if np.asarray(block[port.name]).dtype.kind == "f"]
    typical = {
        **{name: np.asarray(block[name]) for name in names},
        "fSpeed_rpm": random.uniform(5, 2000, rows),
        "fTorque_Nm": random.uniform(-10, 2200, rows),
        "fTemperature_C": random.uniform(20, 40, rows),
        "fOil_C": random.uniform(20, 40, rows),
        "fCycle_s": 10.0 ** random.uniform(-4, 0, rows),
    }
    angle, before = random.uniform(-100, 100, rows), np.zeros(rows)
    kept = Kept({"fCycle_s": Parameter(1e-6, 1.0, 0.0005)}, rows)
    end = cycles - 20
    for cycle in range(cycles):
        if cycle == 3:
            # the acceleration of the sequences is known from the check, that of the others is the initial one
            block["eState"] = random.integers(0, len(states), rows).astype(np.int32)
        angle = angle + block["fMotorSpeed_rpm"] / 60 * 2 * np.pi * np.minimum(typical["fCycle_s"], 0.01)
        typical |= {"fThetaIn_rad": angle, "fThetaOut_rad": angle / 81.0, "fShaftTorque_Nm": block["fLoadTorque_Nm"]}
        given = {n: np.where(random.random(rows) < rate, hostile(random, rows), typical[n]) for n in names}
        if cycle >= end:
            given["fCycle_s"] = np.ones(rows)
        kept.see(given)
        all_inputs(block, given, "bStart", "bAbort", "bEncodersReady")
        block(
            bStart=random.random(rows) < 0.95, bAbort=cycle >= end, bEncodersReady=random.random(rows) < 0.99, **given
        )
        finite(block, [port.name for port in block.outputs])
        speed = block["fMotorSpeed_rpm"]
        step = block["fAcceleration"] * kept.value["fCycle_s"]
        assert np.all(np.abs(speed - before) <= step + UNIT * (np.abs(speed) + np.abs(before) + step)), cycle
        assert np.all(np.abs(speed) <= 1800.0)
        assert np.all(np.abs(block["fLoadTorque_Nm"]) <= 2000.0)
        assert np.all((block["eState"] >= 0) & (block["eState"] < len(states)))
        assert not np.any(block["bDataValid"] & ~np.isin(block["eState"], measuring))
        assert not np.any(block["bDataValid"] & ~block["bBusy"])
        before = speed.copy()
        if cycle >= end:
            assert not np.any(block["fLoadTorque_Nm"])
            assert not np.any(block["bDataValid"])
    assert not np.any(block["bBusy"] & (before == 0.0) & (cycles - end > 2)), "still busy"
    return rows * cycles


#: The angle of the output in rad after a year at the highest input speed.
YEAR = 1800.0 / RATIO / 60 * 2 * np.pi * 365.25 * 86400


#: Cycles of 0.25 ms after which nothing of a bad call is left: 0.1 s of blending between directions, and a set's age.
_CALM = 1000


def run_year(target, rows, seed, cycles):
    """Sequences through both blocks of the two-task form that nothing resets: a year's angles, counters that wrap.

    Every row stands somewhere in a year of turning, in either direction, and its counter of sets wraps around in the
    run. One call in 5,000 has bad inputs. The transmission error is compared with the sum of its harmonics, but not so
    soon after a bad call that its set of harmonics, or the blending from it, may still be there.
    """
    random = np.random.default_rng(seed)
    block = Machine(loaded_with(target, pair(target)), rows=rows, loop_limit=LOOPS).instance("FB_Pair")
    outputs = [port.name for port in block.outputs]
    sign = random.choice([-1.0, 1.0], rows)
    theta, speed = sign * random.uniform(0.0, YEAR, rows), sign * random.uniform(200.0, 1800.0, rows)
    theta[:2] = [YEAR, -YEAR]
    block["stExchange.nSequence"] = (2**31 - 1 - random.integers(0, max(1, cycles // 8), rows)).astype(np.int32)
    fixed = {name: item.default for name, item in parameters_of("FB_CompensatorFast").items()}
    wrapped, compared = np.zeros(rows, bool), 0
    calm = np.full(rows, _CALM)
    for cycle in range(cycles):
        theta = theta + speed / RATIO / 60 * 2 * np.pi * fixed["fCycle_s"]
        given = {name: np.full(rows, value) for name, value in fixed.items()}
        given |= {"fThetaOut_rad": theta, "fSpeed_rpm": speed, "fTorque_Nm": np.full(rows, 900.0)}
        given |= {"fTemperature_C": np.full(rows, 30.0), "bEnable": np.ones(rows, bool)}
        given |= {"bPublishedLaw": np.zeros(rows, bool), "bSlow": np.full(rows, cycle % 4 == 0)}
        bad = random.random(rows) < 0.0002
        calm = np.where(bad, 0, calm + 1)
        for name in ("fThetaOut_rad", "fSpeed_rpm", "fTorque_Nm", "fTemperature_C"):
            given[name] = np.where(bad, hostile(random, rows), given[name])
        all_inputs(block, given, "bLoadGiven")
        block(**given)
        finite(block, outputs)
        assert np.all((block["fWeight"] >= 0.0) & (block["fWeight"] <= 1.0)), cycle
        assert np.all(np.abs(block["fCorrection_deg"]) <= fixed["fCorrectionLimit_deg"])
        wrapped |= np.asarray(block["stExchange.nSequence"]) < 2**30
        sound = np.asarray(block["bValid"]) & (calm > _CALM)
        if cycle % 50 == 49:
            compared += int(sound.sum())
            expected, bound = _te(theta, speed)
            error = np.abs(block["fTE_deg"] - expected)[sound]
            assert np.all(error <= bound[sound]), (cycle, np.max(error / bound[sound]))
    assert wrapped.all(), "a counter did not wrap"
    assert compared > 0.5 * rows * (cycles // 50), compared
    return rows * cycles


def _te(theta, speed):
    """The sum of the harmonics at an angle and speed, 900 Nm and 30 degC, and how far rounding may lead from it."""
    total, bound = np.zeros(len(theta)), np.zeros(len(theta))
    slope = 1e-6 * (np.abs(speed) + 900.0 + 30.0)
    for direction, chosen in enumerate((speed > 0, speed < 0)):
        for order, cosine, sine in zip(ORDERS, *parts(direction), strict=True):
            # in the block a rounding of the angle, of the turns that it is reduced by, and of the order's multiple
            angle = np.remainder(theta.astype(np.longdouble) * order, 2 * np.pi * np.longdouble(1)).astype(float)
            along, across = cosine + slope, (sine + slope) * (order > 0)
            total[chosen] += (along * np.cos(angle) - across * np.sin(angle))[chosen]
            bound[chosen] += (np.hypot(along, across) * (order * np.abs(theta) * 8 + 100) * UNIT)[chosen]
    return total, bound


KINDS = {
    "FB_Compensator": run_compensator,
    "FB_Compensator, forward only": lambda *a: run_compensator(*a, directions=(Direction.FORWARD,)),
    "FB_Compensator, backward only": lambda *a: run_compensator(*a, directions=(Direction.BACKWARD,)),
    "FB_CompensatorSlow and FB_CompensatorFast": lambda *a: run_compensator(*a, two_tasks=True),
    "FB_Compensator with a play": lambda *a: run_compensator(*a, play=PLAY),
    "FB_CompensatorSlow and FB_CompensatorFast with a play": lambda *a: run_compensator(*a, two_tasks=True, play=PLAY),
    "FB_LoadTorque": run_load_torque,
    "FB_Experiment": run_experiment,
}


def main(sequences=100_000, rows=4_000):
    """Run at least that many sequences, shared by all kinds and both dialects; prints a closing line."""
    started, calls, done = time.monotonic(), 0, 0
    jobs = [(kind, target) for kind in KINDS for target in ("twincat", "iec")]
    rounds = -(-sequences // (rows * len(jobs)))
    for number in range(rounds):
        for index, (kind, target) in enumerate(jobs):
            calls += KINDS[kind](target, rows, 1000 * number + index)
            done += rows
            print(f"{done:9,} sequences, {time.monotonic() - started:6.1f} s: {kind}, {target}", flush=True)
    print(f"soak: {done:,} sequences, {calls:,} calls of a block with orders {ORDERS}: nothing violated")


def main_long(calls=5_000_000, rows=500):
    """At least so many calls of both blocks of the two-task form without a restart; prints a closing line."""
    started, done = time.monotonic(), 0
    cycles = -(-calls // (2 * rows))
    for seed, target in enumerate(("twincat", "iec")):
        done += run_year(target, rows, seed, cycles)
        print(f"{done:9,} calls, {time.monotonic() - started:6.1f} s: {target}", flush=True)
    print(f"soak-long: {done:,} calls, {cycles:,} each of {2 * rows:,} sequences, angles to {YEAR:.3g} rad: no fault")


if __name__ == "__main__":
    if "--long" in sys.argv:
        main_long(*(int(argument) for argument in sys.argv[1:] if argument != "--long"))
    else:
        main(*(int(argument) for argument in sys.argv[1:]))
