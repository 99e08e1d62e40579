"""`python -m st_codegen` is the command `st-codegen`."""

from st_codegen.cli.main import main

if __name__ == "__main__":
    main()
