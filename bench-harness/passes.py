#!/usr/bin/env python3
"""How long the passes of a picture take: casting, shading, and the post-process filter, on every engine.

    bench-harness/passes.py ESVO SCENE=OCTREE... [--engines cpu,wgpu,ash] [--rounds 3] > passes.md

ESVO is a release build of the program, SCENE a name of the manifest, whose first two cameras are taken. Each picture is
rendered in every round by every engine in turn; the table has the least time of each pass, summed over both cameras.
"""

import argparse
import re
import subprocess
import sys
import tempfile
from pathlib import Path

TIMES = re.compile(r"casting ([\d.]+) ms, shading ([\d.]+) ms, filter ([\d.]+) ms")
DEVICE = re.compile(r"cast by \S+ on (.*)")


def output_of(command: list[str]) -> tuple[str, str]:
    """Standard output and error of a command. If it fails, its error ends this program."""
    try:
        done = subprocess.run(command, capture_output=True, text=True)
    except OSError as error:
        sys.exit(f"error: {command[0]}: {error.strerror}")
    if done.returncode != 0:
        sys.exit(done.stderr.strip())
    return done.stdout, done.stderr


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", metavar="ESVO")
    parser.add_argument("octrees", metavar="SCENE=OCTREE", nargs="+")
    parser.add_argument("--engines", default="cpu,wgpu,ash")
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    engines = arguments.engines.split(",")
    for entry in arguments.octrees:
        if "=" not in entry:
            sys.exit(f"error: {entry}: expected SCENE=OCTREE, e.g. sibenik=sibenik.esvo")
    print("# What a picture takes\n")
    print("Milliseconds for two pictures of 1024 x 768, rays ending at voxels of one pixel, the least of "
          f"{arguments.rounds} rounds in turn. Casting on a GPU includes copying the hits; shading is done by all cores of the "
          "processor; the filter is measured without copies. A program casts and filters twice, and the second time counts.\n")
    print("| scene | levels | engine | casting | shading | filter | casting / filter |")
    print("|---|--:|---|--:|--:|--:|--:|")
    devices = {}
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "picture.png"
        for entry in arguments.octrees:
            scene, _, octree = entry.partition("=")
            info = output_of([arguments.program, "info", octree])[0]
            levels = re.search(r"(\d+) levels", info).group(1)
            least = {}
            for _ in range(arguments.rounds):
                for engine in engines:
                    for view in ("1", "2"):
                        command = [arguments.program, "render", octree, "--scene", scene, "--view", view, "--times",
                                   "--backend", engine, "-o", str(picture)]
                        said, warnings = output_of(command)
                        sys.stderr.write(warnings)
                        times = [float(time) for time in TIMES.search(said).groups()]
                        before = least.get((engine, view), times)
                        least[engine, view] = [min(pair) for pair in zip(before, times)]
                        devices[engine] = DEVICE.search(said).group(1)
            for engine in engines:
                casting, shading, filtering = (sum(pair) for pair in zip(least[engine, "1"], least[engine, "2"]))
                ratio = f"{casting / filtering:.1f}" if filtering else "no voxel is larger than a pixel"
                print(f"| {scene} | {levels} | {engine} | {casting:.1f} | {shading:.1f} | "
                      f"{filtering:.1f} | {ratio} |", flush=True)
    print()
    for engine in engines:
        print(f"- {engine}: {devices[engine]}")


if __name__ == "__main__":
    main()
