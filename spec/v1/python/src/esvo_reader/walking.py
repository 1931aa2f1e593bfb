"""Follows the pointers of blocks, level by level, and checks each before it is followed (section 5, rules C)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Dict, Iterator, List, NamedTuple, Optional, Tuple

import numpy as np

from .blocks import Block
from .errors import Findings
from .records import (
    CHILD_CORNER,
    DISTANCE,
    HAS_BIT,
    MAX_LEVELS,
    NODE,
    PAGE_SLOTS,
    POPCOUNT,
    RANK,
    Array,
    field,
)

if TYPE_CHECKING:
    from .octree import Octree


class Entrance(NamedTuple):
    """How a block is entered: the descriptors from slot 2 on."""

    #: Level of their voxels.
    level: int
    #: int64, (n, 3): lower corners of their voxels in units of 2^-23.
    position: Array


class Trace(NamedTuple):
    """What was reached in a block."""

    block: Block
    #: The descriptors, breadth first; of type `NODE`.
    nodes: Array
    #: bool, one for each slot of the descriptor array: whether a descriptor or a far pointer is there.
    claimed: Array


class Walk:
    """Visits the blocks of an octree file in the order of the table, which has parents first.

    With a `level`, voxels of that level are not split further, and blocks below it are not read. No slot is entered
    twice and no voxel is below level 23, so the time is linear in what is read, whatever the pointers are.
    """

    def __init__(self, octree: Octree, findings: Findings, level: Optional[int] = None) -> None:
        self.octree, self.findings = octree, findings
        # Without a level even voxels of level 23 are followed, to find those that must not be split (C007).
        self.level = MAX_LEVELS + 1 if level is None else level
        #: How the blocks are entered that were referred to, but not yet visited.
        self.entrances: Dict[int, Entrance] = {}

    def enter_root(self, number: int) -> None:
        """Begins with the root of an object."""
        root = int(self.octree.objects["root_block"][number])
        self.entrances[root] = Entrance(0, np.zeros((1, 3), np.int64))

    def visit(self, block: Block) -> Optional[Trace]:
        """The descriptors of a block; None if nothing that was visited refers to it."""
        entrance = self.entrances.pop(block.index, None)
        return None if entrance is None else BlockWalk(self, block).run(entrance)


class BlockWalk:
    """One block of a walk. Slots are counted from the start of the block."""

    def __init__(self, walk: Walk, block: Block) -> None:
        self.walk, self.block, self.findings = walk, block, walk.findings
        #: For each slot the number of the claim that it belongs to, 0 for none.
        self.owner = np.zeros(len(block.slots), np.uint32)

    def run(self, entrance: Entrance) -> Trace:
        block, level, position = self.block, entrance.level, entrance.position
        slot: Array = np.arange(2, 2 + len(position))
        if 2 + len(slot) > len(block.slots):
            self.findings.add("C002", block.at(0), f"block {block.index} ends within its first descriptors")
            slot = slot[:0]
        levels = int(self.walk.octree.objects["levels"][block.entry["object"]])
        self.claim(slot, slot)
        found: List[Array] = []
        while slot.size:
            if level >= levels:
                self.report(slot, slot >= 0, "C007", f"has voxels of level {level + 1}, the object has {levels}")
                break
            nodes = np.zeros(len(slot), NODE)
            nodes["slot"], nodes["word"] = slot + block.start, block.slots[slot]
            nodes["level"], nodes["position"] = level, position
            valid, leaf = nodes["valid_mask"], nodes["leaf_mask"]
            wrong = (valid == 0) | (leaf & ~valid != 0)
            sound = self.report(slot, wrong, "C001", "has a valid mask of 0 or a leaf mask that is no subset of it")
            nodes = nodes[sound]
            found.append(nodes)
            nonleaf = nodes["valid_mask"] & ~nodes["leaf_mask"]
            slot = nodes["slot"] - block.start
            pointless = (nonleaf == 0) & ((field(nodes, "child_pointer") != 0) | field(nodes, "far"))
            self.report(slot, pointless, "C006", "has a child pointer, but no child has a descriptor")
            if level + 1 >= self.walk.level:
                break
            slot, position = self.children(nodes[nonleaf != 0], level)
            level += 1
        return Trace(block, np.concatenate(found) if found else np.zeros(0, NODE), self.owner != 0)

    def report(self, slot: Array, bad: Array, rule: str, what: str) -> Array:
        """Adds a finding if some of the slots are bad. Returns which are good."""
        if bad.any():
            first, more = int(slot[bad][0]), int(bad.sum()) - 1
            also = f", and {more} more" if more else ""
            self.findings.add(rule, self.block.at(8 * first), f"slot {first} of block {self.block.index} {what}{also}")
        return ~bad

    def claim(self, slot: Array, referrer: Array) -> Array:
        """Gives slots the one purpose that they can have (C005). Returns which had none before."""
        taken = self.owner[slot] != 0
        mark = np.arange(1, 1 + len(slot), dtype=np.uint32)
        self.owner[slot] = mark
        # Of equal slots the last one wins.
        return self.report(referrer, taken | (self.owner[slot] != mark), "C005", "refers to a slot that is in use")

    def children(self, nodes: Array, level: int) -> Tuple[Array, Array]:
        """Slots and positions of the descriptors below these nodes, in this block; notes how others are entered."""
        block = self.block
        nodes, first = self.first_children(nodes)
        slot = nodes["slot"] - block.start
        nonleaf = nodes["valid_mask"] & ~nodes["leaf_mask"]
        count = POPCOUNT[nonleaf]
        beyond = field(nodes, "far") & (first >= len(block.slots))
        for entering in np.flatnonzero(beyond):
            self.enter(nodes[entering], int(first[entering]), nonleaf[entering], level)
        near = ~beyond & self.report(
            slot, ~beyond & (first + count > len(block.slots)), "C002", "leads out of the descriptor array"
        )
        in_page = first % PAGE_SLOTS
        apart = near & ((first % 2 != 0) | (in_page == 0) | (in_page + count > PAGE_SLOTS))
        near &= self.report(slot, apart, "C003", "has children that start at an odd slot or meet a page header")
        row, child = np.nonzero(HAS_BIT[nonleaf] & near[:, None])
        below: Array = first[row] + RANK[nonleaf[row], child]
        position = child_position(nodes["position"][row], child, level)
        free = self.claim(below, slot[row])
        return below[free], position[free]

    def first_children(self, nodes: Array) -> Tuple[Array, Array]:
        """Slots of the first child of nodes; drops nodes whose pointers break a rule."""
        slots, slot = self.block.slots, nodes["slot"] - self.block.start
        near, far = slot + field(nodes, "child_pointer"), field(nodes, "far")
        outside = (near == slot) | (near >= len(slots))
        good = self.report(slot, outside & ~far, "C002", "has a child pointer of 0 or out of the descriptor array")
        good &= self.report(slot, outside & far, "C004", "has a far pointer at itself or out of the descriptor array")
        header = far & good & (near % PAGE_SLOTS == 0)
        good &= self.report(slot, header, "C003", "has a page header as far pointer")
        nodes, slot, near, far = nodes[good], slot[good], near[good], far[good]
        good = np.ones(len(nodes), bool)
        good[far] = self.claim(near[far], slot[far])
        word = slots[near]
        distance, zero = DISTANCE["slots"].of(word).astype(np.int64), DISTANCE["zero"].of(word)
        wrong = far & good & ((distance == 0) | (zero != 0))
        good &= self.report(slot, wrong, "C004", "has a far pointer with distance 0 or a high word that is not zero")
        first = np.where(far, slot + distance, near)
        return nodes[good], first[good]

    def enter(self, node: Array, first: int, nonleaf: int, level: int) -> None:
        """Notes how a far pointer enters another block (C008, B008)."""
        octree, block = self.walk.octree, self.block
        slot, at = int(node["slot"]) - block.start, block.at(8 * (int(node["slot"]) - block.start))
        name, target = f"slot {slot} of block {block.index}", block.start + first
        index = octree.block_of_slot(target)
        if index is None or index == block.index:
            self.findings.add("C002", at, f"{name} leads to no descriptor array")
            return
        entry = octree.blocks[index]
        if target != int(entry["image_offset"]) // 8 + 2 or entry["parent"] != block.index:
            self.findings.add("C008", at, f"{name} leads to slot {target} of the image: not slot 2 of a block below")
            return
        if index in self.walk.entrances:
            self.findings.add("C005", at, f"{name} leads to block {index}, as another does")
            return
        cube, scale = node["position"].tolist(), MAX_LEVELS - level
        if entry["cube_position"].tolist() != cube or entry["cube_scale"] != scale:
            where = octree.block_entry_offset(index, "cube_position")
            self.findings.add("B008", where, f"block {index} is below the cube at {cube} of scale {scale}")
        child = np.flatnonzero(HAS_BIT[nonleaf])
        self.walk.entrances[index] = Entrance(level + 1, child_position(node["position"][None], child, level))


def child_position(position: Array, child: Array, level: int) -> Array:
    """Lower corners of child slots of voxels at a level, int64 (n, 3), in units of 2^-23."""
    half = 1 << MAX_LEVELS - 1 - level
    result: Array = position.astype(np.int64) + half * CHILD_CORNER[child]
    return result


def object_traces(octree: Octree, number: int, level: Optional[int]) -> Iterator[Trace]:
    """Visits the blocks of an object, and raises where one breaks a rule."""
    findings = Findings()
    walk = Walk(octree, findings, level)
    walk.enter_root(number)
    for index in np.flatnonzero(octree.blocks["object"] == number):
        if int(index) in walk.entrances:
            trace = walk.visit(octree.block(int(index)))
            findings.settle()
            if trace is not None:
                yield trace
