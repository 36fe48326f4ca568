"""Looks at a report of `screed wcet` as a reader does: check_wcet_page.py FOLDER. Opens its page in headless Chromium, wide and narrow,
with every fold open: no complaint on the console, every drawing there and drawn inside its frame, nothing wider than the screen, no text
over another in a drawing, every link inside the page leads somewhere. Then the other files: what wcet.json has is in docs/wcet.md, and
samples.csv has as many rows of each kind as it counts. Controls: pages with one fault each, which have to be noticed.
"""
import collections, csv, html, json, os, re, subprocess, sys, tempfile

# Runs inside a copy of the page, and leaves what it found in it.
LOOK = """<script>addEventListener('load', () => {
  const found = [], said = (what) => found.push(what);
  document.querySelectorAll('details').forEach(fold => fold.open = true);
  const wide = document.documentElement.scrollWidth - innerWidth;
  if (wide > 0) said('the page is ' + wide + ' px wider than the screen');
  const clipped = [...document.querySelectorAll('body *')].filter(e => e.getBoundingClientRect().right > innerWidth + 1
    && !e.closest('.wide'));
  clipped.slice(0, 3).forEach(e => said('cut off: ' + e.outerHTML.slice(0, 80)));
  document.querySelectorAll('svg').forEach((svg, number) => {
    const frame = svg.getBoundingClientRect(), words = [...svg.querySelectorAll('text')];
    if (svg.querySelectorAll('path').length < 3 || !(frame.width > 100 && frame.height > 50)) said('drawing ' + number + ' is empty');
    const boxes = words.map(word => word.getBoundingClientRect());
    boxes.forEach((box, k) => {
      if (box.left < frame.left - 1 || box.right > frame.right + 1 || box.top < frame.top - 1 || box.bottom > frame.bottom + 1)
        said('drawing ' + number + ': outside its frame: ' + words[k].textContent);
      boxes.slice(k + 1).forEach((other, j) => {
        const over = Math.min(box.right, other.right) - Math.max(box.left, other.left);
        const under = Math.min(box.bottom, other.bottom) - Math.max(box.top, other.top);
        if (over > 1 && under > 3)
          said('drawing ' + number + ': "' + words[k].textContent + '" over "' + words[k + 1 + j].textContent + '"');
      });
    });
  });
  document.querySelectorAll('a[href^="#"]').forEach(link => {
    if (!document.querySelector(link.getAttribute('href'))) said('leads nowhere: ' + link.textContent);
  });
  if (/NaN|undefined|\\binf\\b/.test(document.body.innerText)) said('a number that is none');
  document.body.dataset.found = JSON.stringify([document.querySelectorAll('svg').length, found]);
})</script>"""
DRAWINGS_MIN = 15
WIDTHS = (1280, 420)


def looked(page, width):
    """How many drawings there are, and what is wrong."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "page.html")
        open(path, "w").write(page + LOOK)
        # A window is at least 500 px wide; a frame in it is not.
        frame = os.path.join(folder, "frame.html")
        open(frame, "w").write("<style>body{margin:0}</style><iframe src='page.html' style='border:0' "
                               f"width={width} height=900 onload=\"document.body.dataset.found="
                               "this.contentDocument.body.dataset.found\"></iframe>")
        done = subprocess.run(["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--allow-file-access-from-files",
                               f"--user-data-dir={folder}/profile", "--enable-logging=stderr", "--window-size=1400,900",
                               "--virtual-time-budget=20000", "--dump-dom", f"file://{frame}"],
                              text=True, capture_output=True, timeout=120)
        console = re.findall(r"CONSOLE.*", done.stderr)
        answer = re.search(r'<body data-found="([^"]*)"', done.stdout)
        if not answer:
            sys.exit(f"Chromium did not show the page (exit code {done.returncode}):\n{done.stderr[-2000:]}")
        count, found = json.loads(html.unescape(answer.group(1)))
        return count, found + console


def wrong_with_page(page):
    wrong = []
    for width in WIDTHS:
        count, found = looked(page, width)
        if count < DRAWINGS_MIN:
            found.append(f"{count} drawings")
        wrong += [f"{width} px: {what}" for what in found]
    return wrong


def wrong_with_files(folder):
    report = json.load(open(os.path.join(folder, "wcet.json")))
    described = open(os.path.join(os.path.dirname(__file__), "../docs/wcet.md")).read()
    wrong = [f"docs/wcet.md does not say what {key} is" for key in report if f"`{key}`" not in described]
    rows = collections.Counter()
    for row in csv.DictReader(open(os.path.join(folder, "samples.csv"))):
        assert int(row["ns"]) >= 0
        rows[row["what"], row["condition"], row["class"]] += 1
    names = {"warm": "warm", "cold": "cold caches", "cold-branches": "cold branches thrashed", "co-runner": "co-runner"}
    for summary in report["times"]:
        what, condition = summary["what"], names[summary["condition"]]
        key = ("cycle", condition, "") if what == "whole cycle" else ("tick", condition, what)
        if rows[key] != summary["count"] or sum(count for _, count in summary["histogram"]) != summary["count"]:
            wrong.append(f"{what}, {condition}: {summary['count']} samples, {rows[key]} in samples.csv")
    for response in report["responses"]:
        key = ("paced response", f"{response['period_ns'] // 1_000_000} ms", "")
        if rows[key] != response["cycles"]:
            wrong.append(f"{key}: {response['cycles']} cycles, {rows[key]} in samples.csv")
    return wrong


def controls(page):
    """Faults that have to be seen."""
    faults = {
        "a broken drawing": page.replace(' d="M', ' d="Mx', 1),
        "too wide": page.replace("<p", '<p style="width:3000px"', 1),
        "words on words": page.replace("</svg>", '<text x="90" y="40">over</text><text x="92" y="41">under</text></svg>', 1),
        "a dead link": page.replace('href="#s3"', 'href="#s99"', 1),
    }
    return [f"the control was not noticed: {name}" for name, spoilt in faults.items() if not looked(spoilt, WIDTHS[0])[1]]


folder = sys.argv[1]
page = open(os.path.join(folder, "wcet.html")).read()
wrong = wrong_with_page(page) + wrong_with_files(folder) + controls(page)
for line in wrong:
    print(line, file=sys.stderr)
if wrong:
    sys.exit(f"{len(wrong)} faults of the report in {folder}")
print(f"the page is as it should be, {' and '.join(map(str, WIDTHS))} px wide; 4 controls noticed")
