"""Here texts are read each time: by what is tested."""

import pytest

from st_codegen.st.syntax import source


@pytest.fixture(autouse=True)
def texts_read_each_time(monkeypatch):
    monkeypatch.setattr(source, "_read_one", source._read_one.read)
