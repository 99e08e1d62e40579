"""A soft PLC that runs in a thread, at a free port of this machine; nothing here waits without an end."""

import asyncio
import contextlib
import itertools
import threading

import pytest

from st_codegen import generate
from st_codegen.live.plc import SoftPlc
from st_codegen.live.serve import Listening, serve
from tests.conftest import BUNDLE, small_lightgbm

#: Each connection of AdsLib has a net id of its own in its process.
NET_IDS = (f"5.77.{number // 250}.{number % 250 + 1}.1.1" for number in itertools.count())


class Running:
    """A PLC with its servers."""

    def __init__(self, plc, **listening):
        self.plc = plc
        self.log = []
        self._listening = Listening(**({"ads_port": 0} | listening))
        self._ready = threading.Event()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def _run(self):
        async def main():
            self._stopping = asyncio.Event()
            await serve(self.plc, self._listening, self._stopping, self.log.append, self._note)

        self._loop.run_until_complete(main())

    def _note(self, addresses):
        self.addresses = addresses
        self._ready.set()

    @property
    def tcp(self):
        return "{}:{}".format(*self.addresses["ads"])

    @property
    def ads(self):
        """The address as the command line takes it, with a net id that nobody else has."""
        return f"{next(NET_IDS)}:851@{self.tcp}"

    def __enter__(self):
        self._thread.start()
        assert self._ready.wait(600), self.log
        return self

    def do(self, function):
        """Call something between two ticks."""
        done = threading.Event()
        self._loop.call_soon_threadsafe(lambda: (function(), done.set()))
        assert done.wait(600)

    def stop(self):
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._stopping.set)
        self._thread.join(600)
        assert not self._thread.is_alive()

    def __exit__(self, *_):
        self.stop()


@pytest.fixture(scope="session")
def model_text():
    """A LightGBM model of two small trees, as text."""
    return small_lightgbm(rows=200, leaves=5, trees=2)


@pytest.fixture(scope="session")
def bundle(tmp_path_factory, model_text):
    """Folders of models and of their generated project."""
    folder = tmp_path_factory.mktemp("live")
    models = folder / "models"
    models.mkdir()
    for name in ("a.txt", "b.txt"):
        (models / name).write_text(model_text)
    (models / "bundle.toml").write_text(BUNDLE, encoding="utf-8")
    made = generate(models, "twincat", folder / "generated", with_comparison=True)
    return models, made.folder


@pytest.fixture(scope="session")
def lone(tmp_path_factory, model_text):
    """Folders of one model and of its generated project, which is read in a moment."""
    folder = tmp_path_factory.mktemp("lone")
    (folder / "models").mkdir()
    (folder / "models" / "te.txt").write_text(model_text)
    made = generate(folder / "models", "twincat", folder / "generated", with_comparison=True)
    return folder / "models", made.folder


def soft_plc(folder, **settings):
    return SoftPlc(folder, **({"optimised": False} | settings))


@pytest.fixture(scope="session")
def shared_plc(bundle):
    """One that all tests use that leave it as it is."""
    with Running(soft_plc(bundle[1])) as running:
        yield running


@pytest.fixture(scope="session")
def lone_plc(lone):
    """The same for the project of one model."""
    with Running(soft_plc(lone[1])) as running:
        yield running
