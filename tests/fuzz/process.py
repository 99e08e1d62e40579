"""One check in a process of its own, with limits of processor time and memory."""

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


def outcome(check, *arguments):
    """Call a check in a child: it returns whether all is equal. Gives the outcome and what the child wrote of it."""
    with tempfile.TemporaryFile() as shown:
        child = os.fork()
        if child == 0:
            _run(check, arguments, shown.fileno())
        status = os.waitpid(child, 0)[1]
        shown.seek(0)
        text = shown.read().decode(errors="replace")
    if not os.WIFSIGNALED(status):
        return _CODES.get(os.WEXITSTATUS(status), Outcome.RAISED), text
    number = os.WTERMSIG(status)
    if number in (signal.SIGXCPU, signal.SIGALRM):
        return Outcome.TOO_SLOW, text
    return Outcome.CRASHED, f"{signal.Signals(number).name}\n{text}"


def _run(check, arguments, output):
    code = 70
    try:
        os.dup2(output, 1)
        os.dup2(output, 2)
        sys.stdout = sys.stderr = open(output, "w", encoding="utf-8", errors="replace", closefd=False)  # noqa: SIM115
        size = _address_space() + MEMORY
        resource.setrlimit(resource.RLIMIT_AS, (size, size))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        spent = int(sum(resource.getrusage(resource.RUSAGE_SELF)[:2]))
        resource.setrlimit(resource.RLIMIT_CPU, (spent + SECONDS, spent + SECONDS + 5))
        signal.alarm(4 * SECONDS)  # what sleeps, on a machine however busy
        code = 0 if check(*arguments) else 3
    except StCodegenError as error:
        code = 2 if str(error).strip() else 70
    except MemoryError:
        sys.stderr.write("MemoryError\n")
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)


def _address_space():
    with open("/proc/self/statm", encoding="ascii") as file:  # noqa: PTH123
        return int(file.read().split()[0]) * resource.getpagesize()
