import pytest

from st_codegen.cli.main import main


def run(*arguments):
    """Exit code of the command line."""
    with pytest.raises(SystemExit) as caught:
        main([str(argument) for argument in arguments])
    return caught.value.code or 0


def snapshot(folder):
    """Every file and folder below a folder, with the bytes of ordinary files."""
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}
