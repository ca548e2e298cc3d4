"""Gaps cut into BVH files, filled in place by `posing clean` and by PCHIP over each channel.

    python3 in_place.py FOLDER-OF-BINARIES TAKE.bvh...      (numpy, scipy)

The rotations of a joint and of all below it (2 joints to a third of the skeleton) become the word nan. Prints the RMS error of the joints that
move, over all gaps of a length and in the median gap, how many gaps clean fills better, and whether every other value keeps its text.
"""

import csv
import os
import subprocess
import sys
import tempfile

import numpy as np
from scipy.interpolate import PchipInterpolator

GAPS = 30
LENGTHS = (0.2, 0.4, 0.7, 1.0)


def read(path):
    """Head, rows of words, channels as (joint, kind), parents, frames a second."""
    text = open(path, encoding="latin1").read()
    start = text.index("\n", text.index("Frame Time")) + 1
    rows = [line.split() for line in text[start:].splitlines() if line.strip()]
    channels, stack, parents, name = [], [], {}, None
    for words in (line.split() for line in text[:start].splitlines()):
        if not words:
            continue
        if words[0] in ("ROOT", "JOINT"):
            name = words[1]
        elif words[0] == "End":
            name = "end"
        elif words[0] == "{":
            parents.setdefault(name, stack[-1] if stack else None)
            stack.append(name)
        elif words[0] == "}":
            stack.pop()
        elif words[0] == "CHANNELS":
            channels += [(stack[-1], kind) for kind in words[2:]]
    rate = 1 / float(text[:start].split("Frame Time:")[1].split()[0])
    return text[:start], rows, channels, parents, rate


def positions(binaries, path):
    done = subprocess.run([f"{binaries}/bvh2xyz", "-q", path], capture_output=True, text=True, check=True)
    rows = list(csv.reader(done.stdout.splitlines()))[1:]
    return np.array([[float(cell or "nan") for cell in row[2:]] for row in rows])


def below(joint, children):
    return [joint] + [j for child in children.get(joint, []) for j in below(child, children)]


def test(binaries, path, folder, generator):
    head, rows, channels, parents, rate = read(path)
    truth, places = np.array(rows, float), positions(binaries, path)
    joints = list(dict.fromkeys(joint for joint, _ in channels))
    children = {}
    for joint in joints:
        children.setdefault(parents[joint], []).append(joint)
    chains = [c for c in (below(j, children) for j in joints[1:]) if 2 <= len(c) <= len(joints) // 3]
    for seconds in LENGTHS:
        length = round(seconds * rate)
        if length < 3 or len(rows) < 3 * length:
            continue
        errors, kept, left = [], True, 0
        for _ in range(GAPS):
            chain = chains[generator.integers(len(chains))]
            columns = [i for i, (joint, _) in enumerate(channels) if joint in chain]
            start = generator.integers(3, len(rows) - length - 3)
            frames = range(start, start + length)
            damaged = [list(row) for row in rows]
            for t in frames:
                for c in columns:
                    damaged[t][c] = "nan"
            write = lambda name, rows: open(f"{folder}/{name}", "w", encoding="latin1").write(
                head + "".join(" ".join(row) + "\n" for row in rows)
            )
            write("gaps.bvh", damaged)
            done = subprocess.run(
                [f"{binaries}/clean", "--again", "-q", f"{folder}/gaps.bvh", "-o", f"{folder}/whole.bvh"],
                capture_output=True,
                text=True,
            )
            assert done.returncode in (0, 3), done.stderr
            for was, now in zip(damaged, read(f"{folder}/whole.bvh")[1]):
                kept &= all(a == b or a == "nan" for a, b in zip(was, now))
            others = np.r_[0:start, start + length : len(rows)]
            simple = truth.copy()
            for c in columns:
                values = truth[others, c]
                if "rotation" in channels[c][1]:
                    values = np.degrees(np.unwrap(np.radians(values)))
                simple[frames, c] = PchipInterpolator(others, values)(frames)
            write("pchip.bvh", [[f"{v:.6f}" for v in row] for row in simple])
            off = [positions(binaries, f"{folder}/{name}.bvh")[frames] - places[frames] for name in ("whole", "pchip")]
            moved = np.abs(off[1]).max(0) > 1e-3
            if np.isnan(off[0]).any():
                left += 1  # too unsure for clean
            elif moved.any():
                errors.append([(o[:, moved] ** 2).mean() for o in off])
        if not errors:
            continue
        clean, pchip = np.array(errors).T
        print(
            f"{os.path.basename(path):36} {seconds:.1f} s  {len(errors):3} gaps"
            f"  RMS {clean.mean() ** 0.5:6.2f} pchip {pchip.mean() ** 0.5:6.2f} cm"
            f"  median {np.median(clean) ** 0.5:5.2f} pchip {np.median(pchip) ** 0.5:5.2f}"
            f"  better in {(clean < pchip).sum()}  left open {left}  {'all else kept' if kept else 'OTHER VALUES CHANGED'}",
            flush=True,
        )


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        for take in sys.argv[2:]:
            test(sys.argv[1], take, folder, np.random.default_rng(7))
