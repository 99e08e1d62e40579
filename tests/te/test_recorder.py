"""PRG_Record: samples of a measurement in a ring, and the end of one whose client is silent."""

import dataclasses

import numpy as np
import pytest

from st_codegen.st import Machine, load_project
from st_codegen.te.compensation.codes import EXPERIMENT_STATE
from st_codegen.te.compensation.recorder import with_recorder
from tests.te.projects import project, texts

STATE = {code.name: code.value for code in EXPERIMENT_STATE.all}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorder")
    contents = project()
    contents = dataclasses.replace(contents, around=with_recorder(contents.around))
    for name, text in texts(contents, "twincat").items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    assert "PRG_Experiment</Name>\n    </PouCall>\n    <PouCall>\n      <Name>PRG_Record" in (
        folder / "PlcTask.TcTTO"
    ).read_text(encoding="utf-8-sig")
    return load_project([folder])


class Signals:
    def __init__(self, machine, name):
        object.__setattr__(self, "_of", lambda key: f"{name}.{key}")
        object.__setattr__(self, "_globals", machine.globals)

    def __getattr__(self, key):
        return self._globals[self._of(key)]

    def __setattr__(self, key, value):
        self._globals[self._of(key)] = value


@pytest.fixture
def plc(recorded):
    machine = Machine(recorded)
    return machine.program("PRG_Record"), Signals(machine, "GVL_Record"), Signals(machine, "GVL_Experiment")


@pytest.mark.parametrize("every", [1, 3, 0])
def test_every_nth_valid_cycle_is_kept_in_the_ring(plc, every):
    program, record, experiment = plc
    record.nEvery, experiment.bBusy = every, True
    record.nSamples = 8190
    for number in range(6):
        experiment.bDataValid = number > 0
        if number == 1:
            record.nSamples = 8190  # near the end of the ring
        experiment.fOut_rad, experiment.bBackward = float(number), number > 3
        program()
    kept = [1, 2, 3, 4, 5] if every < 2 else [1, 4]
    assert record.nSamples == 8190 + len(kept)
    places = np.arange(8190, 8190 + len(kept)) % 8192
    assert record.fOut_rad[places].tolist() == kept
    assert record.bBackward[places].tolist() == [number > 3 for number in kept]
    experiment.bBusy = False
    program()
    experiment.bBusy = True
    program()
    assert (record.nMeasurement, record.nSamples) == (2, 1)


def test_a_measurement_whose_client_is_silent_is_aborted_and_the_next_client_finds_all_as_it_was(plc):
    program, record, experiment = plc
    experiment.bStart = experiment.bBusy = True
    record.fAliveTimeOut_s = 0.01
    for _ in range(50):
        program()
    assert not experiment.bAbort  # nobody has taken it into its hands
    record.nOwner = 5
    for _ in range(50):
        record.nAlive += 1
        program()
    assert not experiment.bAbort
    for _ in range(22):
        program()
    assert experiment.bAbort
    assert not experiment.bStart
    assert record.nOwner == 5  # the axis still moves
    experiment.bBusy, experiment.eState = False, STATE["FAILED"]
    program()
    assert (record.nOwner, experiment.bAbort) == (0, True)
    experiment.eState = STATE["IDLE"]
    program()
    assert not experiment.bAbort


@pytest.mark.parametrize("limit", [np.nan, -1.0, np.inf])
def test_a_limit_that_is_none_aborts(plc, limit):
    program, record, experiment = plc
    experiment.bBusy, record.nOwner, record.fAliveTimeOut_s = True, 1, limit
    program()
    assert experiment.bAbort
