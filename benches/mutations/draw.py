#!/usr/bin/env python3
"""Draws the source lines that carry a mutation, so that nobody chooses them.

    python3 benches/mutations/draw.py [COUNT]

prints COUNT candidates a crate (40 unless said) in the order drawn, from the files of commit BASE. The first twelve of a
crate at which a mutation changes a result stand in mutations.tsv; those passed over stand in skipped.tsv, with the reason.

The mutation of a line is the first of these that compiles and can change a result, at its leftmost place:
1. an arithmetic operator swapped: + and -, * and /, also before =
2. a comparison weakened or strengthened, == and != swapped; of real numbers, where equality never occurs, negated
3. && and || swapped
4. a condition negated; of `if let`, the branch skipped
5. a number doubled; 0 becomes 1
6. the statement skipped
7. min and max swapped
8. a sign, abs or sqrt dropped
"""

import random
import re
import subprocess
import sys
from pathlib import PurePath

SEED = 2026
BASE = "0a151bf4"
CRATES = ["codegen", "solver", "estimation", "discovery", "kinematics"]

OPERATOR = re.compile(
    r" [-+*/%] | [-+*/%]= | (?:<|>|<=|>=|==|!=|&&|\|\|) "  # arithmetic, comparison, boolean
    r"|(?<![\w.\"])\d[\d_]*(?:\.\d+)?(?:e-?\d+)?(?![\w\"])"  # numeric constant
    r"|[ (=\[,]-[a-z(]|(?<![\w\])])!\w"  # sign, negation
    r"|\.(?:min|max|abs|sqrt|clamp|total_cmp)\("
    r"|^\s*(?:return|continue)\b"
    r"|^\s*(?:\} else )?if "
)
STRING = re.compile(r'"(?:[^"\\]|\\.)*"')
PLAIN = re.compile(
    r"^(?:use |pub use |pub\(\w+\) use |#!?\[|//|(?:pub(?:\([^)]*\))? )?(?:const )?(?:fn|struct|enum|trait|mod|type) |impl\b|where\b|[\]\[(){}<>,;]*$)"
)
MESSAGE = re.compile(
    r"\b(?:format|write|writeln|panic|assert\w*|debug_assert\w*|unreachable|println|eprintln)!|\bexpect\(|Error::|Diagnostic|quote!"
)


def source(path):
    return subprocess.run(
        ["git", "show", f"{BASE}:{path}"], check=True, capture_output=True, text=True
    ).stdout


def without_text(line):
    """The line with what stands in strings and comments left out."""
    return re.sub(r"//.*", "", STRING.sub('""', line))


def end_of_block(lines, start):
    """The line on which the item that begins on line start ends: that of its last brace, or of its semicolon."""
    depth = 0
    for i in range(start, len(lines)):
        text = re.sub(r"'.'", "' '", without_text(lines[i]))
        depth += sum(text.count(c) for c in "{([") - sum(text.count(c) for c in "})]")
        if depth <= 0 and re.search(r"[;}]\s*$", text):
            return i
    return len(lines) - 1


def candidates(path):
    lines = source(path).splitlines()
    left_out = set()
    for i, line in enumerate(lines):
        stripped = line.strip()
        test_only = stripped.startswith("#[cfg(test)]")
        if test_only or re.search(r"\bimpl.*\bDisplay for\b", stripped):
            left_out.update(range(i, end_of_block(lines, i + test_only) + 1))
        elif re.match(r"(?:pub(?:\([^)]*\))? )?(?:const )?fn ", stripped):
            # A signature, which may run over several lines: up to its brace.
            j = i
            while j < len(lines) - 1 and not re.search(r"[{;]\s*$", without_text(lines[j])):
                j += 1
            left_out.update(range(i, j + 1))
    # A message that runs over several lines: from its macro to the parenthesis that closes it.
    for i, line in enumerate(lines):
        if MESSAGE.search(line):
            depth, j = 0, i
            while j < len(lines):
                text = without_text(lines[j])
                depth += sum(text.count(c) for c in "([{") - sum(text.count(c) for c in ")]}")
                left_out.add(j)
                if depth <= 0:
                    break
                j += 1
                if j > i + 12:
                    break
    for i, line in enumerate(lines):
        stripped = line.strip()
        if i in left_out or PLAIN.match(stripped):
            continue
        if OPERATOR.search(without_text(line).rstrip()):
            yield path, i + 1, stripped


def main():
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    listed = subprocess.run(
        ["git", "ls-tree", "-r", "--name-only", BASE, "--full-tree"], check=True, capture_output=True, text=True
    ).stdout.split()
    for crate in CRATES:
        files = sorted(
            path
            for path in listed
            if path.startswith(f"{crate}/src/")
            and path.endswith(".rs")
            and not {"tests", "tests.rs"} & set(PurePath(path).parts)
        )
        lines = [found for path in files for found in candidates(path)]
        random.Random(f"{SEED} {crate}").shuffle(lines)
        print(f"# {crate}: {len(lines)} lines")
        for n, (path, line, text) in enumerate(lines[:count], 1):
            print(f"{n}\t{path}\t{line}\t{text}")


if __name__ == "__main__":
    main()
