#!/usr/bin/env python3
"""Counts the mutations that the tests of a worktree catch. Its test binaries are built once and never again.

    python3 benches/mutations/run.py trace --worktree DIR --out OUT [-p PACKAGE]...
    python3 benches/mutations/run.py run --out OUT [--budget-s S] [--only N,N]

trace builds what is stale, then runs every test once without a mutation: OUT/tests.tsv has the time and the outcome of
each test, OUT/reached.tsv which mutations it reaches. run takes each mutation through the tests that reach it, the
quickest first, until one fails, and appends what it found to OUT/results.tsv; mutations that stand there are skipped.

Documentation tests and tests of the compiler's messages (trybuild) are left out of both. A test that fails without a
mutation says nothing and is left out of run.
"""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from datetime import datetime
from pathlib import Path

LEFT_OUT = "(package(tau-ui-tests) | binary(/^ui$/) | test(/trybuild|compile_fail/))"
THREADS = 2
# A command line holds so many names with ease.
MOST_TESTS = 120
RESULTS = "number crate file line kind outcome by reaching tried elapsed_s".split()


def environment(out, **more):
    """The environment of tests: nothing chosen, no file of the worktree rewritten."""
    own = {k: v for k, v in os.environ.items() if not k.startswith(("TAU_", "NEXTEST", "INSTA_", "PROPTEST_"))}
    temporary = out / "tmp"
    temporary.mkdir(exist_ok=True)
    return own | {
        "INSTA_UPDATE": "no",
        "PROPTEST_DISABLE_FAILURE_PERSISTENCE": "true",
        "CARGO_TERM_COLOR": "never",
        "TMPDIR": str(temporary),
        **more,
    }


def clean(out, target):
    """Removes what tests left: temporary files, and sources whose expansion may be that of a mutation."""
    shutil.rmtree(out / "tmp", ignore_errors=True)
    for left in (target / "tmp").glob("*/*.rs"):
        left.unlink()


def configuration(out, timeouts):
    """A configuration of nextest: the report as JUnit, and a timeout (s) for each test (binary, name)."""
    text = '[profile.default]\nfail-fast = false\n[profile.default.junit]\npath = "junit.xml"\n'
    text += f'[store]\ndir = {json.dumps(str(out / "nextest"))}\n'
    for test, seconds in timeouts.items():
        text += f"[[profile.default.overrides]]\nfilter = {json.dumps(expression([test]))}\n"
        text += f'slow-timeout = {{ period = "{seconds}s", terminate-after = 1, grace-period = "2s" }}\n'
    path = out / "nextest.toml"
    path.write_text(text)
    return path


def expression(tests):
    by_binary = {}
    for binary, name in tests:
        by_binary.setdefault(binary, []).append(name)
    return " | ".join(
        f"(binary_id(={binary}) & ({' | '.join(f'test(={name})' for name in names)}))"
        for binary, names in by_binary.items()
    )


def built(out):
    return [
        *("--binaries-metadata", str(out / "binaries.json")),
        *("--cargo-metadata", str(out / "cargo.json")),
    ]


def nextest(out, worktree, filtered, config, env, options=(), limit_s=None):
    """Runs tests; each that ended as {(binary, name): (seconds, failed, time of its end)}; whether all had the time."""
    report = out / "nextest" / "default" / "junit.xml"
    report.unlink(missing_ok=True)
    command = ["cargo", "nextest", "run", *built(out), "--config-file", str(config), "--test-threads", str(THREADS)]
    command += ["--no-tests", "pass", "--status-level", "fail", "--failure-output", "never", "--show-progress", "none"]
    command += ["--color", "never", "-E", filtered, *options]
    with open(out / "log.txt", "a") as log:
        process = subprocess.Popen(
            command, cwd=worktree, env=env, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True
        )
        in_time = True
        try:
            code = process.wait(limit_s)
        except subprocess.TimeoutExpired:
            in_time = False
            # Nextest ends its tests and still reports.
            process.send_signal(signal.SIGINT)
            try:
                code = process.wait(30)
            except subprocess.TimeoutExpired:
                process.kill()
                code = process.wait()
    # 100: some test failed.
    if in_time and code not in (0, 100):
        sys.exit(f"nextest ended with {code}; see {out / 'log.txt'}")
    ended = {}
    if report.exists():
        for suite in ElementTree.parse(report).getroot().iter("testsuite"):
            for case in suite.iter("testcase"):
                seconds = float(case.get("time", 0))
                end = datetime.fromisoformat(case.get("timestamp")).timestamp() + seconds
                failed = any(child.tag in ("failure", "error") for child in case)
                ended[suite.get("name"), case.get("name")] = (seconds, failed, end)
    return ended, in_time


def lines(path):
    rows = [line.split("\t") for line in path.read_text().splitlines()]
    return [dict(zip(rows[0], row)) for row in rows[1:]]


def trace(arguments):
    out, worktree = arguments.out, arguments.worktree.resolve()
    out.mkdir(parents=True, exist_ok=True)
    # Of the whole workspace all the same: other features would be built for fewer packages.
    packages = " | ".join(f"package(={name})" for name in arguments.package) or "all()"
    env = environment(out)

    def kept(name, *command):
        with open(out / name, "w") as file:
            subprocess.run(command, cwd=worktree, env=env, stdout=file, check=True)

    kept("binaries.json", "cargo", "nextest", "list", "--workspace", "--list-type", "binaries-only", "--message-format", "json")
    kept("cargo.json", "cargo", "metadata", "--format-version", "1", "--all-features")
    (out / "worktree").write_text(str(worktree))
    reached = out / "trace.tsv"
    reached.unlink(missing_ok=True)
    began = time.monotonic()
    ended, _ = nextest(
        out,
        worktree,
        f"({packages}) - {LEFT_OUT}",
        configuration(out, {}),
        environment(out, TAU_MUTANT_TRACE=str(reached)),
        ["--no-fail-fast"],
    )
    with open(out / "tests.tsv", "w") as file:
        file.write("binary\ttest\tseconds\toutcome\n")
        for (binary, name), (seconds, failed, _) in sorted(ended.items()):
            file.write(f"{binary}\t{name}\t{seconds:.3f}\t{'failed' if failed else 'passed'}\n")
    found = sorted(set(reached.read_text().splitlines())) if reached.exists() else []
    found = [line.replace(" ", "\t", 1) for line in found]
    (out / "reached.tsv").write_text("\n".join(["binary\ttest\tnumber", *found]) + "\n")
    failed = sum(own[1] for own in ended.values())
    numbers = {line.rsplit("\t", 1)[1] for line in found}
    print(f"{len(ended)} tests, {failed} failed, {time.monotonic() - began:.0f} s; {len(numbers)} mutations reached")


def batches(tests, seconds):
    """Tests in order of rising duration, each batch about as long as all before it."""
    tests = sorted(tests, key=lambda test: (seconds[test], test))
    batch, own_s, all_s = [], 0.0, 0.0
    for test in tests:
        batch.append(test)
        own_s += seconds[test]
        if len(batch) == MOST_TESTS or len(batch) >= THREADS and own_s >= max(4.0, all_s):
            yield batch
            batch, own_s, all_s = [], 0.0, all_s + own_s
    if batch:
        yield batch


def tried(out, worktree, number, tests, seconds, budget_s):
    """Outcome of a mutation, the test that caught it, and how many tests ended."""
    began = time.monotonic()
    env = environment(out, TAU_MUTANT=str(number))
    count = 0
    for batch in batches(tests, seconds):
        left_s = None if budget_s is None else budget_s - (time.monotonic() - began)
        if left_s is not None and left_s <= 0:
            return f"undecided after {count} tests", "", count
        timeouts = {test: int(5 * seconds[test] + 60) for test in batch}
        ended, in_time = nextest(
            out,
            worktree,
            expression(batch),
            configuration(out, timeouts),
            env,
            ["--max-fail", "1:immediate"],
            left_s,
        )
        # What runs when the time is up, or another has failed, is ended and reported as failed.
        failed = [(end, test) for test, (_, is_failed, end) in ended.items() if is_failed]
        if failed and in_time:
            return "caught", " ".join(min(failed)[1]), count + len(ended)
        count += len(ended) - len(failed)
        if not in_time:
            return f"undecided after {count} tests", "", count
        if len(ended) != len(batch):
            sys.exit(f"{len(batch) - len(ended)} tests of a batch did not run; see {out / 'log.txt'}")
    return "survived", "", count


def run(arguments):
    out = arguments.out
    worktree = Path((out / "worktree").read_text())
    target = Path(json.loads((out / "cargo.json").read_text())["target_directory"])
    rows = lines(out / "tests.tsv")
    seconds = {(row["binary"], row["test"]): float(row["seconds"]) for row in rows if row["outcome"] == "passed"}
    reaching = {}
    for row in lines(out / "reached.tsv"):
        test = (row["binary"], row["test"])
        if test in seconds:
            reaching.setdefault(row["number"], set()).add(test)
    results = out / "results.tsv"
    if not results.exists():
        results.write_text("\t".join(RESULTS) + "\n")
    done = {row["number"] for row in lines(results)}
    only = arguments.only and set(arguments.only.split(","))
    for mutation in lines(Path(__file__).with_name("mutations.tsv")):
        number = mutation["number"]
        if number in done or only and number not in only:
            continue
        clean(out, target)
        began = time.monotonic()
        tests = reaching.get(number, set())
        outcome, by, count = "unreached", "", 0
        if tests:
            outcome, by, count = tried(out, worktree, number, tests, seconds, arguments.budget_s)
        found = {"outcome": outcome, "by": by, "reaching": len(tests), "tried": count}
        found["elapsed_s"] = f"{time.monotonic() - began:.1f}"
        with open(results, "a") as file:
            file.write("\t".join(str((mutation | found)[name]) for name in RESULTS) + "\n")
        print(number, outcome, by, f"{count} of {len(tests)} tests", f"{found['elapsed_s']} s", flush=True)
    clean(out, target)
    outcomes = [row["outcome"].split()[0] for row in lines(results)]
    print({name: outcomes.count(name) for name in sorted(set(outcomes))})


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["trace", "run"])
    parser.add_argument("--worktree", type=Path, default=Path(__file__).resolve().parents[2])
    parser.add_argument("--out", type=Path, required=True, help="folder of what is found; outside of the worktree")
    parser.add_argument("-p", "--package", action="append", default=[], help="tests of this package alone")
    parser.add_argument("--budget-s", type=float, help="time (s) after which a mutation stays undecided")
    parser.add_argument("--only", help="numbers of mutations, with commas")
    arguments = parser.parse_args()
    arguments.out = arguments.out.resolve()
    {"trace": trace, "run": run}[arguments.what](arguments)


if __name__ == "__main__":
    main()
