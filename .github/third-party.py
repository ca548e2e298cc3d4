"""Prints the license texts of the crates that a program for TARGET is made of, each text once with its crates.

    python3 third-party.py x86_64-unknown-linux-musl > THIRD-PARTY.txt
"""

import json
import pathlib
import subprocess
import sys

metadata = json.loads(
    subprocess.check_output(
        ["cargo", "metadata", "--format-version", "1", "--locked", "--filter-platform", sys.argv[1]]
        + ["--no-default-features", "--features", "cli"]
    )
)
packages = {package["id"]: package for package in metadata["packages"]}
nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}

# What is linked: neither the build scripts' nor the tests' crates.
linked, waiting = set(), [metadata["resolve"]["root"]]
while waiting:
    for dependency in nodes[waiting.pop()]["deps"]:
        is_linked = any(kind["kind"] is None for kind in dependency["dep_kinds"])
        if is_linked and dependency["pkg"] not in linked:
            linked.add(dependency["pkg"])
            waiting.append(dependency["pkg"])

crates_of = {}
for package in sorted((packages[i] for i in linked), key=lambda p: (p["name"], p["version"])):
    folder = pathlib.Path(package["manifest_path"]).parent
    names = ("LICENSE*", "LICENCE*", "COPYING*", "NOTICE*", "UNLICENSE*")
    files = sorted({file for name in names for file in folder.glob(name) if file.is_file()})
    crate = f"{package['name']} {package['version']} ({package['license']})"
    texts = [file.read_text(errors="replace").strip() for file in files] or ["Its license is in its Cargo.toml."]
    for text in texts:
        crates_of.setdefault(text, []).append(crate)
for text, crates in crates_of.items():
    print("\n".join(crates), "", text, "", "-" * 80, "", sep="\n")
