"""Pages of `diff` and `verify`, and `diff` of revisions of git."""

import hashlib
import re
import shutil
import subprocess

import pytest

from st_codegen.driver import generate
from tests.cli.helpers import run

pytest.importorskip("matplotlib")

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


def other_leaf(text):
    leaf = re.search(r"leaf_value=(\S+)", text)[1]
    return text.replace(leaf, f"{float(leaf) + 0.25!r}"[: len(leaf)].ljust(len(leaf), "0"), 1)


@pytest.fixture
def two(lone_folder, lightgbm_text, tmp_path):
    """Two generated folders, of which one leaf of one of two models differs."""
    (lone_folder / "same.txt").write_text(lightgbm_text)
    assert run(lone_folder, "--out", tmp_path / "old", "-q") == 0
    (lone_folder / "te.txt").write_text(other_leaf(lightgbm_text))
    assert run(lone_folder, "--out", tmp_path / "new", "-q") == 0
    return tmp_path / "old", tmp_path / "new"


def test_a_review_shows_numbers_curves_and_what_stayed(two, tmp_path):
    html, text = tmp_path / "r.html", tmp_path / "r.md"
    assert run("diff", *two, "--html", html, "--markdown", text, "-n", 500, "-q") == 1
    page, marks = html.read_text(encoding="utf-8"), text.read_text(encoding="utf-8")
    assert page.count("<svg") == 3  # one an input
    assert all(name in page for name in ("speed_rpm", "torque_Nm", "temperature_C"))
    for shown in (page, marks):
        assert "1 of 2 models changed in the target twincat." in shown
        assert "same." in shown
        assert "st-codegen diff" in shown
        assert re.search(r"\d+\.\d%", shown)
        assert "No operating range is known" not in shown  # the file has that of the training data
    assert "| te | 0.25 |" in marks
    again = tmp_path / "again.html"
    assert run("diff", *two, "--html", again, "-n", 500, "-q") == 1
    assert re.sub("<footer>.*</footer>", "", again.read_text("utf-8")) == re.sub("<footer>.*</footer>", "", page)


def test_equal_folders_give_a_page_that_says_so(two, tmp_path):
    assert run("diff", two[0], two[0], "--html", tmp_path / "r.html", "-q") == 0
    assert "No difference." in (tmp_path / "r.html").read_text(encoding="utf-8")


def test_verification_has_a_page(lone_folder, tmp_path):
    assert run(lone_folder, "--out", tmp_path, "-q") == 0
    page = tmp_path / "v.html"
    assert run("verify", lone_folder, "-g", tmp_path, "-n", 100, "--cycle-us", 1000, "--html", page, "-q") == 0
    text = page.read_text(encoding="utf-8")
    assert "All agree: library, reference and generated text on a sample of" in text
    assert "te.txt" in text
    digest = hashlib.sha256((tmp_path / "twincat" / "st-codegen.json").read_bytes()).hexdigest()
    assert f"in st-codegen.json, whose own is {digest}." in text
    assert "estimates" in text
    assert "Asked of all inputs: 1 text (proved: 1)." in text
    assert re.search(r"<td>te</td><td>twincat</td><td>proved</td><td>all cells|sums of trees</td>", text)
    assert "Budget: 1000 us: it fits by estimate." in text
    assert run("verify", lone_folder, "-g", tmp_path, "-n", 100, "--cycle-us", 0.1, "--html", page, "-q") == 1
    assert "The cycle DOES NOT FIT: twincat." in page.read_text(encoding="utf-8")


@pytest.mark.thorough
def test_a_page_says_of_how_many_blocks_it_lists_the_slowest(lone_folder, lightgbm_text, tmp_path):
    for number in range(24):
        (lone_folder / f"m{number}.txt").write_text(lightgbm_text)
    page = tmp_path / "e.html"
    assert run(lone_folder, "--out", tmp_path, "-q", "--explain", "--html", page) == 0
    text = page.read_text(encoding="utf-8")
    named = re.search(r"Of (\d+) units the 20 slowest are listed", text)
    assert named is not None and int(named[1]) == 26  # 25 blocks, and F_IsNan that all of them call


def test_a_page_says_what_is_not_proved_and_what_refutes(lone_folder, tmp_path, capsys):
    assert run(lone_folder, "--out", tmp_path, "-q", "--self-check", "--layout", "trees") == 0
    page, (block,) = tmp_path / "v.html", tmp_path.rglob("FB_Te.TcPOU")
    command = ("verify", lone_folder, "-g", tmp_path, "-n", 1, "--html", page, "-q")
    assert run(*command) == 0
    assert "Asked of all inputs: 1 text (not proved: 1)." in page.read_text(encoding="utf-8")
    assert "te, twincat: not proved: the block checks itself (--self-check)" in page.read_text(encoding="utf-8")
    assert run(lone_folder, "--out", tmp_path, "-q", "--layout", "trees") == 0
    text = block.read_text(encoding="utf-8-sig")
    changed = "    fOut1 := aStep1[0] + DINT_TO_LREAL(BOOL_TO_DINT(aInput[0] = 1234567.25));"
    block.write_text(text.replace("    fOut1 := aStep1[0];", changed, 1), encoding="utf-8")
    assert run(*command) == 1
    assert "refuted" in capsys.readouterr().err
    assert "te, twincat: refuted" in page.read_text(encoding="utf-8")


def git(folder, *arguments):
    settings = ["-c", "user.name=a", "-c", "user.email=a@example.invalid", "-c", "init.defaultBranch=main"]
    subprocess.run(["git", "-C", folder, *settings, *arguments], check=True, capture_output=True)


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
@pytest.mark.parametrize("leads_to", ["/etc/hostname", "../../x"])
def test_a_link_out_of_the_folder_of_a_revision_is_no_defect(lone_folder, tmp_path, capsys, leads_to):
    """It was called a defect of st-codegen, with exit code 70."""
    repository = tmp_path / "repository"
    shutil.copytree(lone_folder, repository / "models")
    (repository / "models" / "data").symlink_to(leads_to)
    git(repository, "init")
    git(repository, "add", ".")
    git(repository, "commit", "-m", "one")
    assert run("diff", "HEAD", "HEAD", repository / "models") == 2
    assert "only what is below the folder is compared" in " ".join(capsys.readouterr().err.split())


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
def test_two_revisions_of_models_and_of_generated_files(lone_folder, lightgbm_text, tmp_path, capsys):
    repository = tmp_path / "repository"
    repository.mkdir()
    git(repository, "init")
    shutil.move(lone_folder, repository / "models")
    assert run(repository / "models", "--out", repository / "plc", "-q") == 0
    git(repository, "add", ".")
    git(repository, "commit", "-m", "one")
    (repository / "models" / "te.txt").write_text(other_leaf(lightgbm_text))
    assert run(repository / "models", "--out", repository / "plc", "-q") == 0
    git(repository, "commit", "-a", "-m", "two")
    for path in ("models", "plc"):
        capsys.readouterr()
        assert run("diff", "HEAD~1", "HEAD", repository / path, "-n", 300) == 1
        assert "0.25" in capsys.readouterr().err
        assert run("diff", "HEAD", "HEAD", repository / path, "-q") == 0
    assert run("diff", "HEAD~7", "HEAD", repository / "models") == 2
    assert "revision 'HEAD~7'" in capsys.readouterr().err
    assert run("diff", "--", "--output=x", "HEAD", repository / "models") == 2


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
@pytest.mark.parametrize("width", [400, 1200])
def test_a_page_is_as_wide_as_the_window(two, tmp_path, width):
    page = tmp_path / "r.html"
    assert run("diff", *two, "--html", page, "-n", 200, "-q") == 1
    script = (
        "<script>const e = document.documentElement;"
        "document.title = (e.scrollWidth <= e.clientWidth) + ' ' + window.innerWidth</script>"
    )
    frame = tmp_path / "frame.html"
    page.write_text(page.read_text("utf-8").replace("</body>", f"{script}</body>"), encoding="utf-8")
    frame.write_text(f'<iframe src="r.html" width="{width}" height="800" style="border:0"></iframe>', encoding="utf-8")
    frame_script = "document.querySelector('iframe').onload = e => document.title = e.target.contentDocument.title"
    frame.write_text(f"{frame.read_text()}<script>{frame_script}</script>")
    command = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--allow-file-access-from-files"]
    command += [f"--user-data-dir={tmp_path / 'profile'}", "--virtual-time-budget=5000", "--dump-dom", frame.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=True)
    assert f"<title>true {width}</title>" in done.stdout


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_nothing_of_a_page_is_white_in_the_dark(two, tmp_path):
    image = pytest.importorskip("matplotlib.image")
    page = tmp_path / "r.html"
    assert run("diff", *two, "--html", page, "-n", 200, "-q") == 1
    text = page.read_text("utf-8")
    assert text.count("<svg") >= 1
    bright = {}
    for name, scheme in (("light", "(width < 0)"), ("dark", "all")):
        page.write_text(text.replace("(prefers-color-scheme: dark)", scheme), encoding="utf-8")
        shot = tmp_path / f"{name}.png"
        command = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
        command += ["--window-size=800,1200", f"--screenshot={shot}", page.as_uri()]
        subprocess.run(command, capture_output=True, timeout=600, check=True)
        bright[name] = (image.imread(shot)[..., :3].min(axis=2) > 0.8).mean()
    assert bright["light"] > 0.8
    assert bright["dark"] < 0.1


def test_the_day_stands_on_a_page_on_demand_only(two, tmp_path):
    for options, shown in (((), False), (("--dated",), True)):
        assert run(*options, "diff", *two, "--html", tmp_path / "r.html", "-n", 100, "-q") == 1
        footer = (tmp_path / "r.html").read_text("utf-8").partition("<footer>")[2]
        assert bool(re.search(r"-q, 2\d{3}-\d\d-\d\d", footer)) is shown, footer


def test_what_explain_says_has_a_page(lone_folder, tmp_path, capsys):
    page = tmp_path / "e.html"
    assert run(lone_folder, "--out", tmp_path, "-t", "iec", "-t", "twincat", "--explain", "--html", page, "-q") == 0
    text = page.read_text(encoding="utf-8")
    assert text.count("<svg") == 4
    assert all(f"<h2>{title}" in text for title in ("Inputs that are refused", "Layouts, iec", "Worst case of a cycle"))
    assert "<strong>table</strong>" in text
    assert "st-codegen" in text[text.index("<footer>") :]
    assert run(lone_folder, "--out", tmp_path, "--html", page) == 2
    assert "give --explain" in capsys.readouterr().err


def test_a_large_file_is_announced_with_advice_before_it_is_there(lone_folder, tmp_path, capsys, monkeypatch):
    assert run(lone_folder, "--out", tmp_path, "-q") == 0
    assert "warning" not in capsys.readouterr().err
    monkeypatch.setattr("st_codegen.driver._LARGE_FILE", 5_000)
    heard = []
    generate(lone_folder, "iec", tmp_path, announce=lambda text: heard.append((text, (tmp_path / "iec").exists())))
    ((large, is_there),) = [one for one in heard if "MB of text" in one[0]]
    assert "the largest of" in large and "--table-limit" in large and not is_there
    assert run(lone_folder, "--out", tmp_path) == 0
    assert capsys.readouterr().err.count("MB of text") == 1
