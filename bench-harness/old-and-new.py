#!/usr/bin/env python3
"""Compares two builds of esvo in one interleaved run: bytes, counts, hits and speed.

    bench-harness/old-and-new.py OLD NEW [--rounds 3] [--scenes sibenik,hairball] [--casting-engines cpu] > table.md

OLD and NEW are two release builds of the program `esvo`. Every scene is built and cast by both in turn, round by round.
Bytes, counts and pictures must be equal: exit code 1 if they are not. Times are medians of CPU seconds (building) and
Mrays/s (casting, as `esvo bench` measures them); their ratios are printed, and nothing is decided by them.
"""

import argparse
import hashlib
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

SCENES = [("sibenik", 11), ("conference", 11), ("hairball", 8)]


def run(arguments: list[str]) -> tuple[str, float]:
    """Standard output of a command, and its CPU seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    out = subprocess.run(arguments, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True).stdout
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return out, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def counts(program: str, file: Path) -> dict:
    """What `esvo info` counts, without the name of the file."""
    info = json.loads(run([program, "info", str(file), "--json"])[0])
    info.pop("file", None)
    return info


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old")
    parser.add_argument("new")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--scenes", default=",".join(name for name, _ in SCENES), help="names of scenes, separated by commas")
    parser.add_argument("--casting-engines", default="cpu", help="names of engines, separated by commas")
    options = parser.parse_args()
    wanted = options.scenes.split(",")
    known = [name for name, _ in SCENES]
    for name in wanted:
        if name not in known:
            parser.error(f"--scenes: {name!r} is no scene of this comparison; the scenes are {', '.join(known)}")
    if options.rounds < 1:
        parser.error(f"--rounds {options.rounds}: expected at least 1")
    scenes = [(name, levels) for name, levels in SCENES if name in wanted]
    programs = {"old": os.path.abspath(options.old), "new": os.path.abspath(options.new)}
    different = []

    print(f"# Old and new build, {options.rounds} interleaved rounds\n")
    for which, program in programs.items():
        version = run([program, "--version"])[0].strip().replace("\n", ", ")
        print(f"- {which}: {version}, sha256 {digest(Path(program))}")
    print("\n| scene, levels | sha256 of the octree, old / new | build CPU s, old | new | new / old |\n|---|---|--:|--:|--:|")
    with tempfile.TemporaryDirectory() as folder:
        files = {}
        for scene, levels in scenes:
            seconds = {which: [] for which in programs}
            for _ in range(options.rounds):
                for which, program in programs.items():
                    file = Path(folder) / f"{scene}-{which}.esvo"
                    seconds[which].append(run([program, "build", "--scene", scene, "-l", str(levels), "-o", str(file)])[1])
                    files[scene, which] = file
            hashes = {which: digest(files[scene, which]) for which in programs}
            if counts(programs["new"], files[scene, "old"]) != counts(programs["new"], files[scene, "new"]):
                different.append(f"{scene}: counts")
            if hashes["old"] != hashes["new"]:
                different.append(f"{scene}: bytes")
            old, new = (statistics.median(seconds[which]) for which in ("old", "new"))
            print(f"| {scene} {levels} | {hashes['old']} / {hashes['new']} | {old:.2f} | {new:.2f} | {new / old:.3f} |")

        print("\n| picture | engine | old | new | Mrays/s, old | new | new / old |\n|---|---|---|---|--:|--:|--:|")
        for scene, levels in scenes:
            for engine in options.casting_engines.split(","):
                for mode in ([], ["--no-contours"], ["--beam"]):
                    pictures = {}
                    for which, program in programs.items():
                        picture = Path(folder) / f"{which}.png"
                        file = str(files[scene, which])
                        run([program, "render", file, "-o", str(picture), "--scene", scene, "-b", engine, *mode])
                        pictures[which] = digest(picture)
                    if pictures["old"] != pictures["new"]:
                        different.append(f"{scene}: picture by {engine} {mode}")
                    name = f"{scene} {levels} {' '.join(mode)}".strip()
                    print(f"| {name} | {engine} | {pictures['old']} | {pictures['new']} | | | |")
            rates: dict = {which: {} for which in programs}
            for _ in range(options.rounds):
                for which, program in programs.items():
                    command = [program, "bench", "--scenes", scene, "--levels", str(min(levels, 9)), "--backends", options.casting_engines]
                    command += ["--resolutions", "1024x768", "--rounds", "3", "--views", "2", "--json"]
                    report = json.loads(run([*command, "--out", str(Path(folder) / "results")])[0])
                    for row in report["scenes"][0]["times"]:
                        key = (row["backend"], row["variant"])
                        rates[which].setdefault(key, []).append(row["mrays"]["median"])
            for key in rates["old"]:
                old, new = (statistics.median(rates[which][key]) for which in ("old", "new"))
                print(f"| {scene} {min(levels, 9)}, {key[1]} | {key[0]} | | | {old:.2f} | {new:.2f} | {new / old:.3f} |")
    print("\n" + ("Different: " + "; ".join(different) if different else "Bytes, counts and pictures are equal."))
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
