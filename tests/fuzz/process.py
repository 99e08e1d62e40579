"""Checks in processes of their own, with limits of processor time and memory."""

import gc
import os
import resource
import signal
import sys
import tempfile
import traceback
from enum import StrEnum

from st_codegen.errors import StCodegenError

SECONDS, MEMORY = 30, 2 * 2**30


class Outcome(StrEnum):
    """How a check of a mutant ended; only the first two are as they should be."""

    REFUSED = "refused"
    ACCEPTED = "accepted and equal"
    DIFFERENT = "accepted, but different"
    RAISED = "unexpected exception"
    CRASHED = "crashed"
    TOO_SLOW = "too slow"


GOOD = (Outcome.REFUSED, Outcome.ACCEPTED)
_CODES = {0: Outcome.ACCEPTED, 2: Outcome.REFUSED, 3: Outcome.DIFFERENT}
_ENOUGH = 200


class Server:
    """Checks one mutant after another in a child, which a fresh one follows when it ends, and after `_ENOUGH` of them.

    Starting a process takes many times as long as most checks. What an earlier mutant left behind must not decide:
    every outcome that is not good is that of a second check, in a process that has seen nothing else.
    """

    def __init__(self, check, *arguments):
        self._check, self._arguments = check, arguments
        self._child, self._left = 0, 0

    def __enter__(self):
        return self

    def __exit__(self, *raised):
        self._end()

    def outcome(self):
        """Give the outcome and what the check wrote of it."""
        if not self._left:
            self._end()
            self._start()
        self._left -= 1
        os.write(self._asks, b"?")
        code = os.read(self._answers, 1)
        found = _CODES.get(code[0]) if code else None
        if found in GOOD:
            return found, ""
        self._end()
        return outcome(self._check, *self._arguments)

    def _start(self):
        asked, self._asks = os.pipe()
        self._answers, answered = os.pipe()
        self._left = _ENOUGH
        self._child = os.fork()
        if self._child == 0:
            os.close(self._asks)
            os.close(self._answers)
            with open(os.devnull, "w") as nowhere:  # noqa: PTH123
                _prepare(nowhere.fileno())
                while os.read(asked, 1):
                    _limit_time()
                    os.write(answered, bytes([_code(self._check, self._arguments)]))
                    signal.alarm(0)
            os._exit(0)
        os.close(asked)
        os.close(answered)

    def _end(self):
        if self._child:
            os.close(self._asks)
            os.close(self._answers)
            os.waitpid(self._child, 0)
            self._child = self._left = 0


def outcome(check, *arguments):
    """Call a check in a child: it returns whether all is equal. Gives the outcome and what the child wrote of it."""
    with tempfile.TemporaryFile() as shown:
        child = os.fork()
        if child == 0:
            _prepare(shown.fileno())
            _limit_time()
            os._exit(_code(check, arguments))
        status = os.waitpid(child, 0)[1]
        shown.seek(0)
        text = shown.read().decode(errors="replace")
    if not os.WIFSIGNALED(status):
        return _CODES.get(os.WEXITSTATUS(status), Outcome.RAISED), text
    number = os.WTERMSIG(status)
    if number in (signal.SIGXCPU, signal.SIGALRM):
        return Outcome.TOO_SLOW, text
    return Outcome.CRASHED, f"{signal.Signals(number).name}\n{text}"


def _prepare(output):
    """What the process writes goes to a file, and its memory is limited; collections do not copy what it was given."""
    gc.freeze()
    os.dup2(output, 1)
    os.dup2(output, 2)
    sys.stdout = sys.stderr = open(output, "w", encoding="utf-8", errors="replace", closefd=False)  # noqa: SIM115
    size = _address_space() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (size, size))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _limit_time():
    """The seconds of one check, from now on."""
    spent = int(sum(resource.getrusage(resource.RUSAGE_SELF)[:2]))
    resource.setrlimit(resource.RLIMIT_CPU, (spent + SECONDS, resource.RLIM_INFINITY))
    signal.alarm(4 * SECONDS)  # what sleeps, on a machine however busy


def _code(check, arguments):
    """Run a check; a number that says how it ended."""
    try:
        return 0 if check(*arguments) else 3
    except StCodegenError as error:
        return 2 if str(error).strip() else 70
    except MemoryError:
        sys.stderr.write("MemoryError\n")
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
    return 70


def _address_space():
    with open("/proc/self/statm", encoding="ascii") as file:  # noqa: PTH123
        return int(file.read().split()[0]) * resource.getpagesize()
