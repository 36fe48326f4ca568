"""Compares counted figures with the committed ones, or writes them anew: wcet_compare.py FILE FOLDER [update REASON].

FOLDER holds what `screed wcet --figures`, the firmware and .ci/stack_bound print: x86_64, cortex_m7, stack; and coverage, if that was
measured (.ci/wcet_coverage).
"""
import json, os, sys, tomllib

LARGER = 1.02
PAGE = "docs/wcet.md"


def counted(folder):
    """What was printed, in the shape of the file."""
    found = {"x86_64": {}, "cortex_m7": {}, "cortex_m7_painted": {}, "stack": {}}
    for name in ("x86_64", "cortex_m7", "stack"):
        for line in open(os.path.join(folder, name)):
            kind, *rest = line.rstrip("\n").split("|")
            if kind == "rustc":
                found["rustc"] = rest[0]
            elif kind == "figure":
                arm, what, vectors, least, most, worst = rest
                row = {"vectors": int(vectors), "min": int(least), "max": int(most), "worst": worst}
                found[name].setdefault(arm, {})[what] = row
            elif kind == "painted":
                found["cortex_m7_painted"][rest[0]] = int(rest[1])
            elif kind == "stack":
                target, root, bound, functions, way = rest
                row = {"bound": int(bound), "functions": int(functions), "path": way.split(" > ")}
                found["stack"].setdefault(target, {})[root] = row
    path = os.path.join(folder, "coverage")
    if os.path.exists(path):
        found["coverage"] = json.load(open(path))
    return found


def differences(old, new):
    """What is wrong, in words."""
    wrong = []
    if old["rustc"] != new["rustc"]:
        wrong.append(f"the figures hold for {old['rustc']!r}, this is {new['rustc']!r}: use that compiler, or update them")
    for name in ("x86_64", "cortex_m7"):
        for arm in sorted(old[name].keys() | new[name].keys()):
            classes, counts = old[name].get(arm, {}), new[name].get(arm, {})
            for what in sorted(classes.keys() | counts.keys()):
                before, now = classes.get(what), counts.get(what)
                place = f"{name}, {arm}, {what}"
                if before is None or now is None:
                    wrong.append(f"{place}: only {'counted' if before is None else 'committed'}")
                elif before["vectors"] != now["vectors"]:
                    wrong.append(f"{place}: {now['vectors']} vectors, committed {before['vectors']}")
                elif now["max"] > LARGER * before["max"]:
                    more = 100 * (now["max"] / before["max"] - 1)
                    wrong.append(f"{place}: {now['max']} instructions ({now['worst']}), {more:.1f} % more than {before['max']}")
    for what, now in new["cortex_m7_painted"].items():
        if now > old["cortex_m7_painted"].get(what, 0):
            wrong.append(f"painted, {what}: {now} bytes, committed {old['cortex_m7_painted'].get(what)}")
    for target, roots in new["stack"].items():
        for root, now in roots.items():
            before = old["stack"].get(target, {}).get(root, {"bound": 0})
            if now["bound"] > before["bound"]:
                wrong.append(f"stack, {target}, {root}: {now['bound']} bytes, committed {before['bound']}")
    bound = new["stack"]["Cortex-M7"]["root_loop_tick_9"]["bound"]
    deepest = max(new["cortex_m7_painted"].values())
    if deepest > bound:
        wrong.append(f"painted: {deepest} bytes, more than the bound of {bound}")
    # Both processors run the same courses: what they count must be the same calls.
    for arm, classes in new["x86_64"].items():
        for what, row in classes.items():
            there = new["cortex_m7"].get(arm, {}).get(what, {}).get("vectors")
            if there != row["vectors"]:
                wrong.append(f"{arm}, {what}: {row['vectors']} vectors here, {there} on the Cortex-M7")
    return wrong


def keep_reasons(old, new, reason):
    """A line that has not changed keeps its reason."""
    for name in ("x86_64", "cortex_m7", "stack"):
        for group, rows in new[name].items():
            for what, row in rows.items():
                before = dict(old.get(name, {}).get(group, {}).get(what, {}))
                why = before.pop("reason", reason)
                row["reason"] = why if before == row else reason
    if "coverage" not in new:
        new["coverage"] = old["coverage"]


def text(figures):
    word = lambda value: json.dumps(value, ensure_ascii=False)
    row = lambda values: "{ " + ", ".join(f"{key} = {word(value)}" for key, value in values.items()) + " }"
    out = ["# Written by `.ci/wcet update REASON`, compared by `.ci/wcet`. Instructions, bytes.", f"rustc = {word(figures['rustc'])}"]
    for name in ("x86_64", "cortex_m7", "stack"):
        for group, rows in figures[name].items():
            out += ["", f"[{name}.{word(group)}]"]
            out += [f"{word(what)} = {row(values)}" for what, values in rows.items()]
    out += ["", "[cortex_m7_painted]"]
    out += [f"{word(what)} = {size}" for what, size in figures["cortex_m7_painted"].items()]
    coverage = figures["coverage"]
    out += ["", "[coverage]"] + [f"{key} = {word(coverage[key])}" for key in ("command", "branches", "lines")]
    out += ["", "[coverage.short]"] + [f"{word(file)} = {counts}" for file, counts in coverage["short"].items()]
    return "\n".join(out) + "\n"


AIM = 150_000  # instructions on the Cortex-M7, without replay and with at most two poses a tick: `M7_AIM` of host/src/wcet.


def aim(figures):
    """Which arms hold it."""
    most = lambda classes: {arm: max(rows[what]["max"] for what in classes if what in rows) for arm, rows in figures["cortex_m7"].items()}
    usual, burst, replay = most(("motion only", "+ pose", "+ rates", "fault")), most(("+ burst of poses",)), most(("+ replay",))
    told = lambda arms: ", ".join(f"{arm} {count:,}" for arm, count in arms)
    held = [(arm, count) for arm, count in usual.items() if count <= AIM]
    missed = [(arm, count) for arm, count in usual.items() if count > AIM]
    lines = [f"The aim of at most {AIM:,} instructions on the Cortex-M7 without replay, with at most two poses a tick, is held by: {told(held)}."]
    lines += [f"It is missed by: {told(missed)}."] if missed else []
    return "\n".join(lines + [f"Bursts of up to 16 poses take {max(burst.values()):,} at most, ticks with replay {max(replay.values()):,}."])


def page(figures):
    """What docs/wcet.md shows of the figures, by the name of its marks."""
    arm = "UR10e (closed form)"
    rows = [f"| {what} | {row['max']:,} | {figures['cortex_m7'][arm][what]['max']:,} |" for what, row in figures["x86_64"][arm].items()]
    table = ["| class | x86-64 | Cortex-M7 |", "| --- | --- | --- |", *rows]
    bound = lambda target, joints: f"{figures['stack'][target][f'root_loop_tick_{joints}']['bound']:,}"
    branches, lines = figures["coverage"]["branches"], figures["coverage"]["lines"]
    stack = (f"Stack: at most {bound('x86-64', 6)} bytes for a tick with the loop and six joints on x86-64, {bound('Cortex-M7', 6)} on the Cortex-M7; "
             f"with nine joints {bound('x86-64', 9)} and {bound('Cortex-M7', 9)}. Painted on the Cortex-M7, all arms: "
             f"{max(figures['cortex_m7_painted'].values()):,}.")
    coverage = (f"The courses run {branches[0]:,} of {branches[1]:,} branch sides of the kernel and {lines[0]:,} of {lines[1]:,} lines "
                "(`.ci/wcet_coverage`, at the last update).")
    return {"table": "\n".join(table), "aim": aim(figures), "stack": f"{stack}\n\n{coverage}"}


def with_figures(text, figures):
    """The page with what it has to show between its marks."""
    for name, block in page(figures).items():
        begin, end = f"<!-- figures: {name} -->\n", f"\n<!-- end of {name} -->"
        before, _, rest = text.partition(begin)
        _, found, after = rest.partition(end)
        if not found:
            sys.exit(f"docs/wcet.md has no marks {begin.strip()} … {end.strip()}")
        text = before + begin + block + end + after
    return text


def main(file, folder, mode="check", reason=None):
    old = tomllib.load(open(file, "rb"))
    new = counted(folder)
    if mode == "update":
        keep_reasons(old, new, reason)
        written = text(new)
        open(file, "w").write(written)
        shown = open(PAGE).read()
        open(PAGE, "w").write(with_figures(shown, new))
        return
    wrong = differences(old, new)
    if open(PAGE).read() != with_figures(open(PAGE).read(), old):
        wrong.append(f"{PAGE} shows other figures than {file}")
    for line in wrong:
        print(line, file=sys.stderr)
    if wrong:
        sys.exit(f"{len(wrong)} differences from {file}; if they are meant: .ci/wcet update \"REASON\"")
    count = sum(len(rows) for name in ("x86_64", "cortex_m7") for rows in new[name].values())
    largest = lambda name: max(row["max"] for rows in new[name].values() for row in rows.values())
    print(f"{count} figures as committed; the most {largest('x86_64')} instructions here, {largest('cortex_m7')} on the Cortex-M7")


main(*sys.argv[1:])
