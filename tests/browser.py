"""Pages in Chromium: nothing is cut, nothing is wider than the window, no two labels lie on each other."""

import html
import json
import re
import shutil
import subprocess

import pytest

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
MEASURE = """
const f = document.getElementById("f");
f.onload = () => {
  const d = f.contentDocument, wide = d.documentElement.clientWidth, found = [];
  if (d.documentElement.scrollWidth > wide) found.push("the page is wider than the window");
  for (const e of d.querySelectorAll("p, h1, h2, svg, td, th")) {
    const r = e.getBoundingClientRect();
    const scrolls = e.closest(".wide table");
    if (!scrolls && (r.right > wide + 1 || r.left < -1)) found.push("cut: " + e.textContent.slice(0, 60));
  }
  d.querySelectorAll("svg").forEach((svg, n) => {
    const box = svg.getBoundingClientRect(), texts = [...svg.querySelectorAll("text")];
    const rects = texts.map(t => t.getBoundingClientRect());
    rects.forEach((a, i) => {
      if (a.left < box.left - 1 || a.right > box.right + 1 || a.top < box.top - 1 || a.bottom > box.bottom + 1)
        found.push("picture " + n + " cuts '" + texts[i].textContent + "'");
      for (let j = 0; j < i; j++) {
        const b = rects[j];
        const x = Math.min(a.right, b.right) - Math.max(a.left, b.left);
        const y = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
        // a third of the height is the leading of a line
        if (x > 1.5 && y > 0.34 * Math.min(a.height, b.height))
          found.push("picture " + n + ": '" + texts[i].textContent + "' on '" + texts[j].textContent + "'");
      }
    });
  });
  document.title = JSON.stringify([d.querySelectorAll("svg text").length, found]);
};
f.srcdoc = PAGE;
"""


def faults(page, width, folder):
    """How many labels the pictures of a page have in a window of this width, and all that is wrong there."""
    if CHROMIUM is None:
        pytest.skip("no Chromium here: the layout of the page was not looked at (apt-get install chromium)")
    quoted = json.dumps(page).replace("</", "<\\/")
    frame = f'<iframe id="f" style="width:{width}px;height:9000px;border:0"></iframe>'
    script = MEASURE.replace("PAGE", quoted)
    (folder / "frame.html").write_text(f"<!DOCTYPE html><meta charset=utf-8>{frame}<script>{script}</script>")
    done = subprocess.run(
        [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder / 'profile'}",
         "--window-size=1600,9100", "--virtual-time-budget=20000", "--dump-dom", str(folder / "frame.html")],
        capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    title = re.search(r"<title>(.*?)</title>", done.stdout, re.DOTALL)
    assert title is not None, done.stderr[-2000:]
    count, found = json.loads(html.unescape(title[1]))
    return count, found
