"""The command `st-codegen`, as which `python -m st_codegen` runs too."""

import gc
import signal
import sys

#: New objects after which Python looks for garbage: of the hundreds of thousands that libraries make when they are
#: imported, none is.
_LOOKS_AFTER = 50_000


def main() -> None:
    """Run the command. Ctrl-C while it is still being loaded ends it as it does later; SIGTERM ends it as Ctrl-C does.

    By default SIGTERM ends a process at once: workers, and folders that it had begun, would stay behind it.
    """
    gc.set_threshold(_LOOKS_AFTER)
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:  # who started it may have it ignored
        signal.signal(signal.SIGTERM, _stop)
    try:
        from st_codegen.cli.main import main as command
    except KeyboardInterrupt:
        sys.stderr.write("error: stopped\n")
        sys.exit(130)  # as `cli.main` and shells have it
    command()


def _stop(*_: object) -> None:
    """What SIGTERM does, also where Ctrl-C is ignored, as it is for what a script leaves in its background."""
    signal.raise_signal(signal.SIGINT)
    raise KeyboardInterrupt


if __name__ == "__main__":
    main()
