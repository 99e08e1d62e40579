"""The command `st-codegen`, as which `python -m st_codegen` runs too."""

import gc
import sys

#: New objects after which Python looks for garbage: of the hundreds of thousands that libraries make when they are
#: imported, none is.
_LOOKS_AFTER = 50_000


def main() -> None:
    """Run the command. Ctrl-C while it is still being loaded ends it as it does later."""
    gc.set_threshold(_LOOKS_AFTER)
    try:
        from st_codegen.cli.main import main as command
    except KeyboardInterrupt:
        sys.stderr.write("error: stopped\n")
        sys.exit(130)  # as `cli.main` and shells have it
    command()


if __name__ == "__main__":
    main()
