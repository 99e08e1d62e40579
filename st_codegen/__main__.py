"""The command `st-codegen`, as which `python -m st_codegen` runs too."""

import sys


def main() -> None:
    """Run the command. Ctrl-C while it is still being loaded ends it as it does later."""
    try:
        from st_codegen.cli.main import main as command
    except KeyboardInterrupt:
        sys.stderr.write("error: stopped\n")
        sys.exit(130)  # as `cli.main` and shells have it
    command()


if __name__ == "__main__":
    main()
