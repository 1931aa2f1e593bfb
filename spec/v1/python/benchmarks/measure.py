"""Prints how long opening and reading a file take: python benchmarks/measure.py FILE

Every line is measured in a new process, which reads the file once before it starts the clock, so that the disk is not
measured. Next to the time that passed is that of the processor, which says more on a machine that does other work.
"""

from __future__ import annotations

import argparse
import pathlib
import resource
import subprocess
import sys
import time

import esvo_reader


def open_only(octree):
    return f"{len(octree.blocks):,} blocks"


def one_block(octree):
    block = octree.block(len(octree.blocks) // 2)
    return f"block {block.index}: {len(block.image):,} bytes, sum of slots {int(block.slots.sum()):#x}"


def descriptors(octree):
    found = octree.descriptors()
    return f"{len(found):,} descriptors, {found.nbytes / 1e6:,.0f} MB"


def slots(octree):
    return f"{len(octree.descriptor_slots()):,} slots"


def one_part(octree):
    return f"{len(next(octree.iter_leaves())):,} leaf voxels with attributes"


def coarse(octree):
    return f"{len(octree.leaves(6)):,} voxels with attributes"


def walk(octree):
    return f"{sum(len(nodes) for n in range(len(octree.objects)) for nodes in octree.walk(n)):,} descriptors"


def leaves(octree):
    parts = (part for number in range(len(octree.objects)) for part in octree.iter_leaves(number=number))
    return f"{sum(map(len, parts)):,} leaf voxels with attributes"


def validate(octree):
    return f"{len(octree.validate())} findings"


STEPS = {
    "open": ("open: header, directory, tables", open_only),
    "block": ("one block", one_block),
    "descriptors": ("all descriptors as one array", descriptors),
    "slots": ("the slots of all descriptors", slots),
    "part": ("leaves of the first block", one_part),
    "coarse": ("voxels of the first object down to level 6", coarse),
    "walk": ("walk, every pointer checked", walk),
    "leaves": ("all leaves, block by block", leaves),
    "validate": ("validate", validate),
}


def measure(step, path):
    """Prints the line of one step. Opening is in none but its own."""
    with path.open("rb") as file:
        while file.read(1 << 20):
            pass
    begin, cpu = time.perf_counter(), time.process_time()
    octree = esvo_reader.open(path)
    if step != "open":
        begin, cpu = time.perf_counter(), time.process_time()
    found = STEPS[step][1](octree)
    passed, used = time.perf_counter() - begin, time.process_time() - cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"| {STEPS[step][0]} | {found} | {1e3 * passed:,.1f} | {1e3 * used:,.1f} | {peak / 1024:,.0f} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=pathlib.Path)
    parser.add_argument("--step", choices=STEPS, help="only this one, in this process")
    chosen = parser.parse_args()
    if chosen.step:
        measure(chosen.step, chosen.file)
        return
    print(f"{chosen.file.name}, {chosen.file.stat().st_size:,} bytes\n")
    print("| step | result | ms | ms of the processor | peak MiB |")
    print("|---|---|---:|---:|---:|", flush=True)
    for step in STEPS:
        subprocess.run([sys.executable, __file__, str(chosen.file), "--step", step], check=True)


if __name__ == "__main__":
    main()
