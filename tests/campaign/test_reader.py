"""A whole campaign: parallel and alone, with and without what was read before, and bad files all at once."""

import os
import signal
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("polars")
pytest.importorskip("joblib")

from st_codegen.campaign import reader
from st_codegen.campaign.conditions import OperatingPoint, temperatures_of_no_oil
from st_codegen.campaign.curves import Curve, Run, write_run
from st_codegen.campaign.orders import BAND
from st_codegen.campaign.reader import AROUND, read_campaign
from st_codegen.errors import InputError, MissingExtraError
from st_codegen.te.harmonics import Direction
from st_codegen.training.measured import measured_table
from st_codegen.training.search import Backend

ORDERS = (0, 1, 39)
#: Other digits, as many.
_NINES = str.maketrans("12345678", "87654321")
VALUES = np.array([-0.03, 0.0172 * np.exp(0.3j), 1e-3 * np.exp(2j)])


@pytest.fixture
def folder(tmp_path):
    """Six runs of two directions, 2000 samples each."""
    random = np.random.default_rng(3)
    for number in range(6):
        theta = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
        theta = theta + 0.003 * np.sin(2 * theta)
        curves = {}
        for direction in Direction:
            angle = theta if direction is Direction.FORWARD else 2 * np.pi - theta
            te = (np.exp(1j * np.outer(angle, ORDERS)) @ (VALUES * (1 + number))).real + 1e-6 * random.normal(size=2000)
            curves[direction] = Curve(np.rad2deg(angle), te)
        conditions = OperatingPoint(100.0 * (number + 1), 100.0, 25.0)
        write_run(Run(conditions, curves), tmp_path / "campaign" / conditions.rig_path(), digits=9)
    return tmp_path / "campaign"


def coefficients(campaign):
    return campaign.table(campaign.fits(ORDERS))


def test_the_table_of_a_campaign(folder):
    table = coefficients(read_campaign(folder, jobs=1))
    assert len(table) == 12
    assert table.speed_rpm.tolist() == sorted(np.repeat(100.0 * np.arange(1, 7), 2))
    assert table.backward.tolist() == [False, True] * 6
    factor = table.speed_rpm / 100.0
    # noise of 1e-6 on 2000 samples, six standard deviations, and nine decimals
    assert np.abs(table.coefficients - factor[:, None] * VALUES).max() < 6 * 1e-6 * np.sqrt(4 / 2000) + 1e-9


def test_the_files_are_read_wherever_the_work_is_done_around(folder, tmp_path):
    joblib = pytest.importorskip("joblib")
    alone, seen = coefficients(read_campaign(folder, jobs=1)), []
    with joblib.parallel_config(backend="threading", n_jobs=2):
        together = read_campaign(folder, jobs=AROUND, progress=lambda done, total, name: seen.append(name))
    assert np.array_equal(alone.coefficients, coefficients(together).coefficients)
    assert seen == [path.name for path in sorted(folder.rglob("*.csv"))]


def test_as_many_workers_read_as_are_asked_for_but_no_more_than_files(folder, monkeypatch):
    """What is read around has as many as the caller has chosen."""
    joblib = pytest.importorskip("joblib")
    asked, parallel = [], joblib.Parallel
    monkeypatch.setattr(joblib, "Parallel", lambda **given: asked.append(given.get("n_jobs")) or parallel(**given))
    with joblib.parallel_config(backend="threading", n_jobs=1):
        for jobs in (2, 64, AROUND, 1):
            assert len(read_campaign(folder, jobs=jobs).curves) == 12
    assert asked == [2, 6, None]


def test_a_small_campaign_does_not_wait_for_workers(folder, monkeypatch):
    """They took three seconds to start, the files a fifth of one to read."""
    joblib = pytest.importorskip("joblib")
    asked, parallel = [], joblib.Parallel
    monkeypatch.setattr(joblib, "Parallel", lambda **given: asked.append(given.get("n_jobs")) or parallel(**given))
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    size = sum(path.stat().st_size for path in folder.rglob("*.csv"))
    with joblib.parallel_config(backend="threading", n_jobs=1):
        for most in (size, size - 1):
            monkeypatch.setattr(reader, "_WITHOUT_WORKERS_BYTES", most)
            assert len(read_campaign(folder).curves) == 12
    assert asked == [2]


def test_without_the_extra_one_worker_reads_and_several_are_refused(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "joblib", None)
    assert len(read_campaign(folder, jobs=1).curves) == 12
    with pytest.raises(MissingExtraError, match=r"st-codegen\[train\]"):
        read_campaign(folder, jobs=2)


@pytest.mark.slow
def test_one_campaign_is_read_by_the_workers_of_a_cluster(folder, tmp_path, monkeypatch):
    """Two worker processes, one of which is killed while it reads: nothing is lost, and nothing is read here."""
    distributed = pytest.importorskip("distributed")
    alone = measured_table(folder, ORDERS, 3, where=Backend(1)).table
    killed = []
    monkeypatch.setattr(reader, "read_run", lambda path, conditions: pytest.fail(f"{path} was read here"))
    monkeypatch.chdir(tmp_path)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, memory_limit=0
    ) as cluster:

        def kill(*_):
            if not killed:
                killed.append(next(iter(cluster.workers.values())).pid)
                os.kill(killed[0], signal.SIGKILL)

        backend = Backend(1, cluster.scheduler_address)
        spread = measured_table(Path(folder.name), ORDERS, 3, where=backend, progress=kill).table
    assert killed
    assert np.array_equal(alone.coefficients, spread.coefficients)


def test_processes_and_cache_give_the_same_bits(folder, tmp_path, monkeypatch):
    cache = tmp_path / "cache" / "curves.parquet"
    alone = coefficients(read_campaign(folder, jobs=1))
    together = coefficients(read_campaign(folder, jobs=2, cache=cache))
    assert np.array_equal(alone.coefficients, together.coefficients)
    monkeypatch.setattr(reader, "read_run", lambda path, conditions: pytest.fail(f"{path} was read again"))
    again = coefficients(read_campaign(folder, jobs=1, cache=cache))
    assert np.array_equal(alone.coefficients, again.coefficients)
    assert [path.name for path in cache.parent.iterdir()] == ["curves.parquet"]


def test_a_campaign_of_one_curve_is_kept_too(tmp_path, monkeypatch):
    theta, conditions = np.linspace(0, 360, 2000, endpoint=False), OperatingPoint(100.0, 100.0, 25.0)
    curves = {Direction.FORWARD: Curve(theta, 0.01 * np.cos(np.deg2rad(theta)))}
    write_run(Run(conditions, curves), tmp_path / "campaign" / conditions.rig_path())
    read_campaign(tmp_path / "campaign", jobs=1, cache=tmp_path / "kept.parquet")
    monkeypatch.setattr(reader, "read_run", lambda path, conditions: pytest.fail(f"{path} was read again"))
    assert len(read_campaign(tmp_path / "campaign", jobs=1, cache=tmp_path / "kept.parquet").curves) == 1


def test_changed_files_are_read_again(folder, tmp_path):
    cache = tmp_path / "curves.parquet"
    read_campaign(folder, jobs=1, cache=cache)
    first, second, *_ = sorted(folder.rglob("*.csv"))
    os.utime(first, ns=(1, 1))
    second.unlink()
    seen = []
    campaign = read_campaign(folder, jobs=1, cache=cache, progress=lambda done, total, name: seen.append(name))
    assert seen == [first.name]
    assert len(campaign.curves) == 10


def test_a_cache_of_another_version_is_made_anew(folder, tmp_path):
    pl = pytest.importorskip("polars")
    cache = tmp_path / "curves.parquet"
    pl.DataFrame({"version": [1], "band": [BAND], "plain_fft": [0.0]}).write_parquet(cache)
    for _ in range(2):
        assert len(read_campaign(folder, jobs=1, cache=cache).curves) == 12
        assert cache.stat().st_size > 10_000
        cache.write_bytes(b"")


def test_files_of_others_are_not_written_over(folder, tmp_path):
    pl = pytest.importorskip("polars")
    cache = tmp_path / "mine.parquet"
    pl.DataFrame({"mine": [1, 2]}).write_parquet(cache)
    for content in (cache.read_bytes(), b"no parquet"):
        cache.write_bytes(content)
        with pytest.raises(InputError, match=r"mine\.parquet is not a file of what was read of curve files"):
            read_campaign(folder, jobs=1, cache=cache)
        assert cache.read_bytes() == content


def test_a_cache_for_which_the_disk_has_no_room(folder, tmp_path):
    """What polars says of a full disk was a defect of ours."""
    resource = pytest.importorskip("resource")
    cache = tmp_path / "curves.parquet"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))
    try:
        with pytest.raises(OSError, match="File too large") as found:
            read_campaign(folder, jobs=1, cache=cache)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert found.value.filename == cache
    assert [path.name for path in tmp_path.iterdir()] == ["campaign"]


def test_a_cache_that_cannot_be_read_is_no_file_of_others(folder, tmp_path, monkeypatch):
    """Whoever may not read it was told to delete it."""
    pl = pytest.importorskip("polars")
    cache = tmp_path / "curves.parquet"
    read_campaign(folder, jobs=1, cache=cache)

    def refused(*_, **__):
        raise PermissionError(13, "Permission denied", str(cache))

    monkeypatch.setattr(pl, "read_parquet", refused)
    with pytest.raises(InputError, match=r"curves\.parquet: cannot be read \(Permission denied\)"):
        read_campaign(folder, jobs=1, cache=cache)


def test_a_campaign_with_names_sizes_and_times_of_another_one_is_read(folder, tmp_path):
    """As two folders have that were unpacked from archives, which keep times of whole seconds."""
    cache, other = tmp_path / "curves.parquet", tmp_path / "other"
    for path in sorted(folder.rglob("*.csv")):
        copy = other / path.relative_to(folder)
        copy.parent.mkdir(parents=True, exist_ok=True)
        head, *lines = path.read_text().splitlines()
        columns = [line.split(",") for line in lines]
        text = "\n".join([head, *(",".join([a, te.translate(_NINES), b, back]) for a, te, b, back in columns)]) + "\n"
        copy.write_text(text)
        for one in (path, copy):
            os.utime(one, ns=(10**18, 10**18))
        assert copy.stat().st_size == path.stat().st_size
    first, second = (coefficients(read_campaign(one, jobs=1, cache=cache)) for one in (folder, other))
    assert np.abs(first.coefficients[::2] - second.coefficients[::2]).min() > 0


def test_another_band_is_another_cache(folder, tmp_path):
    cache = tmp_path / "curves.parquet"
    read_campaign(folder, jobs=1, cache=cache, band=100)
    assert read_campaign(folder, jobs=1, cache=cache, band=200).curves[0].sums.band == 200


def spoil(folder):
    """Three bad files of six, each in its own way, and one without conditions."""
    files = sorted(folder.rglob("*.csv"))
    lines = files[0].read_text().splitlines()
    lines[100] = "1,2,x,4"
    files[0].write_text("\n".join(lines))
    files[1].write_text("\n".join(files[1].read_text().splitlines()[:300]))
    files[2].write_bytes(b"\xff\xfe\x00")
    (folder / "notes.csv").write_text("a,b\n1,2\n")
    return files


def test_bad_files_are_reported_all_at_once(folder, tmp_path):
    files = spoil(folder)
    with pytest.raises(InputError, match=r"skip_bad = true\): 4 problems") as error:
        read_campaign(folder, jobs=2)
    text = str(error.value)
    assert f"{files[0]}, line 101: 'x' is not a number" in text
    assert f"{files[1]}, line 300: forward: the angle covers 53." in text
    assert f"{files[2]}: the text is " in text
    assert "notes.csv: no conditions" in text


def test_bad_files_are_left_out_on_request(folder):
    spoil(folder)
    campaign = read_campaign(folder, jobs=1, skip_bad=True)
    assert len(campaign.curves) == 6
    assert len(campaign.bad) == 4


def test_nothing_good_is_left(folder):
    for path in folder.rglob("*.csv"):
        path.write_text("")
    with pytest.raises(InputError, match="no usable curve files"):
        read_campaign(folder, jobs=1, skip_bad=True)


def test_too_few_samples_for_an_order_are_named(folder):
    with pytest.raises(InputError, match="12 problems") as error:
        read_campaign(folder, jobs=1).fits([0, 450])
    assert "100.0rpm100.0Nm25.0deg.csv, forward" in str(error.value)


def test_a_single_bad_file_is_an_input_error_like_many(tmp_path):
    (tmp_path / "900rpm1Nm25deg.csv").write_text("x")
    with pytest.raises(InputError, match=r"leave them out with --skip-bad.*900rpm1Nm25deg.csv, line 1: unknown column"):
        read_campaign(tmp_path)


def test_files_that_cannot_be_what_they_say_are_bad_ones(folder, tmp_path):
    """A temperature of a broken sensor took the drift out of the rig; an error code among samples became an order."""
    files = sorted(folder.rglob("*.csv"))
    files[0].rename(files[0].with_name("100.0rpm100.0Nm850.0deg.csv"))
    lines = files[1].read_text().splitlines()
    for number in range(100, 100 + len(lines) // 10):
        cells = lines[number].split(",")
        lines[number] = ",".join((cells[0], "9999", *cells[2:]))
    files[1].write_text("\n".join(lines))
    with pytest.raises(InputError, match="2 problems") as error:
        read_campaign(folder, jobs=1)
    assert "a temperature of 850 degC, in the median run 25" in str(error.value)
    assert "TE scatters by 3e+03 deg in the turn, in the median run by 0.0" in str(error.value)
    assert len(read_campaign(folder, jobs=1, skip_bad=True).curves) == 8


def _with_te(file, direction, value):
    """One direction of a curve file with this in place of all TE."""
    head, *lines = file.read_text().splitlines()
    column = 1 if direction is Direction.FORWARD else 3
    cells = [line.split(",") for line in lines]
    file.write_text("\n".join([head, *(",".join([*row[:column], value, *row[column + 1 :]]) for row in cells)]))


def test_a_dead_channel_is_a_bad_file(folder):
    """A run with 0 throughout was learned from like any other one."""
    files = sorted(folder.rglob("*.csv"))
    _with_te(files[2], Direction.BACKWARD, "0.0")
    with pytest.raises(InputError, match=r"backward: TE is the same in all samples, .* a dead channel\?"):
        read_campaign(folder, jobs=1)
    assert len(read_campaign(folder, jobs=1, skip_bad=True).curves) == 10
    for file in files:
        _with_te(file, Direction.BACKWARD, "0.0")  # all of them are no exception
    assert len(read_campaign(folder, jobs=1).curves) == 12


def test_te_whose_squares_are_no_numbers_is_a_bad_file(folder):
    """It ended as a defect, with an OverflowError."""
    _with_te(sorted(folder.rglob("*.csv"))[2], Direction.FORWARD, "1e200")
    with pytest.raises(InputError, match=r"TE is up to 1e\+200 deg; no more than 1e\+15 is read"):
        read_campaign(folder, jobs=1)


def test_the_ending_of_curve_files_may_be_in_capitals(folder):
    """On systems that tell capitals apart these were left out without a word."""
    file = min(folder.rglob("*.csv"))
    file.rename(file.with_suffix(".CSV"))
    assert len(read_campaign(folder, jobs=1).curves) == 12


def test_temperatures_that_are_all_in_another_unit_are_no_single_labels():
    kelvin = np.array([298.0, 299.0, 300.0])
    assert not temperatures_of_no_oil(kelvin).any()
    assert temperatures_of_no_oil(np.array([25.0, 26.0, -273.15, 30.0, 9999.0])).tolist() == [0, 0, 1, 0, 1]
