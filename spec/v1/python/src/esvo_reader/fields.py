"""Codec 2: blocks as streams of fields, and the layout that makes an image of them (section 4.4)."""

from __future__ import annotations

from typing import Any, Callable, Dict, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from .records import (
    AMBIENT_BLOCKS,
    ATTACHMENT_ENTRY,
    COLOR_BLOCKS,
    CONSTANT_COLOR,
    CORNERS,
    INFO_SECTION,
    NORMAL_BLOCKS,
    PAGE_BYTES,
    PAGE_SLOTS,
    PLAIN_COLORS,
    PLAIN_NORMALS,
    POPCOUNT,
    Array,
)

#: A field: lowest bit and width.
Field = Tuple[int, int]
BYTES: Tuple[Field, ...] = ((0, 8), (8, 8), (16, 8), (24, 8))
BASE: Tuple[Field, ...] = ((0, 6), (6, 8), (14, 7), (21, 8), (29, 3))
COLOR_HEAD: Tuple[Field, ...] = ((0, 5), (5, 6), (11, 5), (16, 5), (21, 6), (27, 5))
CONTOUR_NORMAL: Tuple[Field, ...] = ((0, 6), (6, 6), (12, 6))
CONTOUR_REST: Tuple[Field, ...] = ((18, 7), (25, 7))
NONE, NEAR, FAR, BLOCK = range(4)
APART, JOINED, RAW = range(3)
#: How many streams an attachment has.
STREAMS = {
    COLOR_BLOCKS: 10,
    NORMAL_BLOCKS: 18,
    CONSTANT_COLOR: 0,
    AMBIENT_BLOCKS: 8,
    PLAIN_COLORS: 5,
    PLAIN_NORMALS: 6,
    CORNERS: 13,
}
#: A byte of a Zstandard frame stands for at most this many.
MAX_RATIO = 32768
MAX_KINDS = 3
#: Decompresses a frame that must have this many bytes.
Unpack = Callable[[bytes, int], bytes]


class Level(NamedTuple):
    """The descriptors of one level, in the order of their slots."""

    valid: Array
    nonleaf: Array
    links: Array
    #: Of links to other blocks: the blocks.
    children: Array
    contour_masks: Array
    contours: Array
    #: For each attachment: masks of the descriptors (None for pairs), and values.
    values: List[Tuple[Optional[Array], Array]]


class Fields:
    """What the parts of a block hold. Everything that is wrong raises `ValueError`."""

    def __init__(self, limit: int, unpack: Unpack) -> None:
        """`limit`: the size of the image of the block."""
        self.limit, self.unpack = limit, unpack
        self.array_slots = 0
        #: Type and, of a constant colour, its bytes.
        self.kinds: List[Tuple[int, bytes]] = []
        self.levels: List[Level] = []

    def add(self, body: bytes, levels: int) -> None:
        """Reads the part that follows those before."""
        rest = Rest(body)
        if not self.levels:
            self._read_front(rest)
        counts = [rest.number(4) for _ in range(levels)]
        used = sum(len(level.valid) for level in self.levels)
        if 0 in counts or used + sum(counts) > self.limit // 8:
            raise ValueError(f"levels of {counts} descriptors")
        streams = self._streams(rest)
        self._read_levels(counts, streams)
        streams.end()

    def _read_front(self, rest: Rest) -> None:
        self.array_slots = rest.number(4)
        if not 4 <= self.array_slots <= self.limit // 8:
            raise ValueError(f"a descriptor array of {self.array_slots} slots")
        count = rest.number(1)
        if count > MAX_KINDS:
            raise ValueError(f"{count} attachments")
        for _ in range(count):
            kind = rest.number(2)
            if kind not in STREAMS:
                raise ValueError(f"attachment type {kind}")
            self.kinds.append((kind, rest.take(8) if kind == CONSTANT_COLOR else b""))

    def _streams(self, rest: Rest) -> Streams:
        form = rest.number(1)
        if form == APART:
            sizes = [rest.varint() for _ in range(14 + sum(STREAMS[kind] for kind, _ in self.kinds))]
            if sum(size >> 1 for size in sizes) != rest.left():
                raise ValueError("the streams do not fill the part")
            return Streams(rest, sizes, self.unpack)
        if form not in (JOINED, RAW):
            raise ValueError(f"form {form}")
        total = rest.varint()
        if form == RAW:
            if total != rest.left():
                raise ValueError("the streams do not fill the part")
            return Streams(rest, None, self.unpack)
        if total > 2 * self.limit or total // MAX_RATIO > rest.left():
            raise ValueError(f"streams of {total} bytes")
        return Streams(Rest(self.unpack(rest.take(rest.left()), total)), None, self.unpack)

    def _read_levels(self, counts: List[int], streams: Streams) -> None:
        nodes = sum(counts)
        valid, nonleaf = streams.next(nodes), streams.next(nodes)
        links = np.zeros(nodes, np.uint8)
        stored = streams.next(int((nonleaf != 0).sum()))
        if (stored > 2).any():
            raise ValueError("a link that is none of 0 to 2")
        links[nonleaf != 0] = stored + 1
        steps = streams.words(int((links == BLOCK).sum()), BYTES)
        children = np.cumsum(steps, dtype=np.uint32)
        masks = streams.next(nodes)
        pairs = self._check_counts(counts, nonleaf, links)
        contours = read_contours(int(POPCOUNT[masks].sum()), self.limit, streams)
        columns = [self._read_values(kind, valid, sum(pairs), streams) for kind, _ in self.kinds]
        ends = np.cumsum(counts)
        pair_ends = np.cumsum(pairs)
        for k, (low, high) in enumerate(zip(ends - counts, ends)):
            pick = slice(int(low), int(high))

            def of(per_node: Array, values: Array, at: slice = pick) -> Array:
                # The values of some descriptors, of those of all.
                return values[int(per_node[: at.start].sum()) : int(per_node[: at.stop].sum())]

            values: List[Tuple[Optional[Array], Array]] = []
            for (kind, _), (mask, column) in zip(self.kinds, columns):
                if mask is None:
                    at = slice(int(pair_ends[k] - pairs[k]), int(pair_ends[k]))
                    values.append((None, column[at] if kind != CONSTANT_COLOR else column))
                else:
                    values.append((mask[pick], of(value_counts(kind, mask, valid), column)))
            self.levels.append(
                Level(
                    valid[pick],
                    nonleaf[pick],
                    links[pick],
                    of((links == BLOCK).astype(np.int64), children),
                    masks[pick],
                    of(POPCOUNT[masks], contours),
                    values,
                )
            )

    def _check_counts(self, counts: List[int], nonleaf: Array, links: Array) -> List[int]:
        """The pairs of each level, once the levels fit together."""
        pairs, at = [], 0
        above = None
        if self.levels:
            last = self.levels[-1]
            above = POPCOUNT[last.nonleaf[(last.links == NEAR) | (last.links == FAR)]]
        for count in counts:
            groups = np.array([count]) if above is None else above
            if int(groups.sum()) != count or (above is None and count > 8):
                raise ValueError(f"a level of {count} descriptors")
            pairs.append(int(((groups + 1) // 2).sum()))
            part = slice(at, at + count)
            inside = (links[part] == NEAR) | (links[part] == FAR)
            above = POPCOUNT[nonleaf[part][inside]]
            at += count
        return pairs

    def _read_values(self, kind: int, valid: Array, pairs: int, streams: Streams) -> Tuple[Optional[Array], Array]:
        if kind == CONSTANT_COLOR:
            return None, np.zeros(0, np.uint64)
        if kind == NORMAL_BLOCKS:
            return None, read_rows(pairs, streams)
        if kind in (COLOR_BLOCKS, AMBIENT_BLOCKS):
            low = streams.words(pairs, COLOR_HEAD if kind == COLOR_BLOCKS else BYTES)
            return None, slots_of(low, streams.words(pairs, BYTES))
        if kind == CORNERS:
            mask = streams.words(len(valid), BYTES)
            count = int(value_counts(kind, mask, valid).sum())
            self._check_values(8 * count)
            low = streams.words(count, BYTES)
            return mask, slots_of(low, streams.words(count, BASE))
        mask = streams.next(len(valid))
        count = int(value_counts(kind, mask, valid).sum())
        self._check_values(4 * count)
        return mask, streams.words(count, BASE if kind == PLAIN_NORMALS else BYTES)

    def _check_values(self, size: int) -> None:
        if size > self.limit:
            raise ValueError("more values than fit")


class Rest:
    """Bytes that are read from the front."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def left(self) -> int:
        return len(self.data) - self.at

    def take(self, count: int) -> bytes:
        if count > self.left():
            raise ValueError("the part ends too early")
        self.at += count
        return self.data[self.at - count : self.at]

    def number(self, size: int) -> int:
        return int.from_bytes(self.take(size), "little")

    def varint(self) -> int:
        number = 0
        for k in range(5):
            byte = self.number(1)
            number |= (byte & 127) << 7 * k
            if byte < 128:
                return number
        raise ValueError("a number of more than five bytes")


class Streams:
    """The streams of a part, one after the other."""

    def __init__(self, rest: Rest, sizes: Optional[List[int]], unpack: Unpack) -> None:
        self.rest, self.unpack = rest, unpack
        self.sizes = None if sizes is None else iter(sizes)

    def next(self, count: int) -> Array:
        """The next stream, uint8, which must have this many bytes."""
        if self.sizes is None:
            return np.frombuffer(self.rest.take(count), np.uint8)
        size = next(self.sizes)
        stored = self.rest.take(size >> 1)
        if size & 1:
            if count // MAX_RATIO > len(stored):
                raise ValueError(f"a stream of {count} bytes from {len(stored)}")
            stored = self.unpack(stored, count)
        if len(stored) != count:
            raise ValueError(f"a stream of {len(stored)} bytes instead of {count}")
        return np.frombuffer(stored, np.uint8)

    def words(self, count: int, fields: Sequence[Field]) -> Array:
        """uint32: words of these fields."""
        words = np.zeros(count, np.uint32)
        for low, width in fields:
            stream = self.next(count)
            if (stream >> width if width < 8 else stream[:0]).any():
                raise ValueError("a byte that is wider than its field")
            words |= stream.astype(np.uint32) << np.uint32(low)
        return words

    def tokens(self, count: int) -> Array:
        """Numbers of two bits."""
        packed = self.next((count + 3) // 4)
        tokens = (packed[:, None] >> np.array([0, 2, 4, 6], np.uint8) & 3).reshape(-1)
        if tokens[count:].any():
            raise ValueError("bits after the last token")
        return tokens[:count]

    def end(self) -> None:
        if self.rest.left():
            raise ValueError("the streams do not fill the part")


def slots_of(low: Array, high: Array) -> Array:
    """uint64 of the two words."""
    return low.astype(np.uint64) | high.astype(np.uint64) << np.uint64(32)


def value_counts(kind: int, mask: Array, valid: Array) -> Array:
    """How many values each descriptor has."""
    counts: Array
    if kind == CORNERS:
        bits = POPCOUNT[(mask & np.uint32(0x7FFFFFF)).astype("<u4")[:, None].view(np.uint8)].sum(axis=1)
        counts = bits + 8 * (mask >> np.uint32(27) & np.uint32(1)).astype(np.int64)
    else:
        counts = POPCOUNT[mask] + ((valid & ~mask) != 0)
    return counts


def read_contours(count: int, limit: int, streams: Streams) -> Array:
    """The words of contours."""
    if 4 * count > limit:
        raise ValueError(f"{count} contours, more than fit")
    tokens = streams.tokens(count)
    new = streams.words(int((tokens == 3).sum()), CONTOUR_NORMAL).tolist()
    rest = streams.words(count, CONTOUR_REST)
    normals = np.zeros(count, np.uint32)
    recent, fresh = [0, 0, 0], iter(new)
    for k, token in enumerate(tokens.tolist()):
        value = recent.pop(token) if token < 3 else next(fresh)
        recent = [value, *recent][:3]
        normals[k] = value
    return normals | rest


def read_rows(count: int, streams: Streams) -> Array:
    """Normal blocks, two slots each: uint64 (n, 2)."""
    tokens = streams.tokens(count)
    base = streams.words(int((tokens >= 2).sum()), BASE)
    full = int((tokens == 3).sum())
    u, axes, v = (streams.words(full, BYTES) for _ in range(3))
    rows = np.zeros((count, 2), np.uint64)
    recent = [(0, 0), (0, 0)]
    bases, firsts, seconds = iter(base.tolist()), iter(u.tolist()), iter(slots_of(axes, v).tolist())
    for k, token in enumerate(tokens.tolist()):
        if token == 1:
            recent.reverse()
        elif token >= 2:
            low = next(bases)
            row = (low, 0) if token == 2 else (next(firsts) << 32 | low, next(seconds))
            recent = [row, recent[0]]
        rows[k] = recent[0]
    return rows


class Group(NamedTuple):
    """Siblings that have their slots."""

    level: int
    #: Indices into the level.
    nodes: range
    slot: int


class Layout:
    """The slots of the descriptors of a block."""

    def __init__(self, fields: Fields) -> None:
        self.levels = fields.levels
        self.groups: List[Group] = []
        self.cursor = 2
        self.next = [0] * len(self.levels)
        #: Distance from each descriptor with children to what its child pointer leads to.
        self.pointers: Dict[int, int] = {}
        #: Far pointers: their slots, those of their descriptors, and where they lead in the block.
        self.far: List[Tuple[int, int, int]] = []
        #: The same of those to other blocks: with the number of the link in its level.
        self.outer: List[Tuple[int, int, int, int]] = []
        self._run()

    def _place(self, level: int, count: int) -> Group:
        if level >= len(self.levels):
            raise ValueError("the last level has children")
        start = self.next[level]
        nodes = range(start, start + count)
        self.next[level] += count
        needed = count + int((self.levels[level].links[start : start + count] >= FAR).sum())
        if self.cursor % PAGE_SLOTS == 0 or self.cursor % PAGE_SLOTS + needed > PAGE_SLOTS:
            self.cursor += -self.cursor % PAGE_SLOTS + 2
        group = Group(level, nodes, self.cursor)
        self.cursor += needed
        self.cursor += self.cursor % 2
        self.groups.append(group)
        return group

    def _run(self) -> None:
        links = [level.links.tolist() for level in self.levels]
        counts = [POPCOUNT[level.nonleaf].tolist() for level in self.levels]
        outer = [0] * len(self.levels)
        group = self._place(0, len(self.levels[0].valid))
        # Each entry: a group, how many of its members are done, and its next far pointer.
        stack = [(group, 0, group.slot + len(group.nodes))]
        while stack:
            group, done, pointer = stack.pop()
            if done == len(group.nodes):
                continue
            node, slot, level = group.nodes[done], group.slot + done, group.level
            link = links[level][node]
            stack.append((group, done + 1, pointer + (link >= FAR)))
            if link == NONE:
                continue
            if link == BLOCK:
                self.outer.append((pointer, slot, level, outer[level]))
                outer[level] += 1
                self.pointers[slot] = pointer - slot
                continue
            below = self._place(level + 1, counts[level][node])
            stack.append((below, 0, below.slot + len(below.nodes)))
            self.pointers[slot] = (below.slot if link == NEAR else pointer) - slot
            if link == FAR:
                self.far.append((pointer, slot, below.slot - slot))


def image(fields: Fields, index: int, start: int, starts: Callable[[int], Optional[int]]) -> Array:
    """uint8: the image of block `index`, which begins at slot `start`; `starts` says the same of other blocks."""
    layout = Layout(fields)
    count = layout.cursor
    info = 8 * count
    pool = info + INFO_SECTION.itemsize + ATTACHMENT_ENTRY.itemsize * len(fields.kinds)
    contours = sum(len(level.contours) for level in fields.levels)
    end, places = pool + 4 * contours, []
    for number, (kind, _) in enumerate(fields.kinds):
        size = attachment_bytes(kind, count, sum(len(level.values[number][1]) for level in fields.levels))
        at = end + -end % 8
        places.append((kind, at, size))
        end = at + size
    end += -end % PAGE_BYTES
    if end != fields.limit or count != fields.array_slots:
        raise ValueError(f"the fields make {end} bytes and {count} slots")
    data = np.zeros(end, np.uint8)
    slots = data[:info].view("<u8")
    slots[::PAGE_SLOTS] = count - PAGE_SLOTS * np.arange(len(slots[::PAGE_SLOTS]))
    _write_descriptors(fields, layout, data, slots, pool)
    _write_outer(fields, layout, slots, start, starts)
    record = data[info : info + INFO_SECTION.itemsize].view(INFO_SECTION)
    record["block"], record["array_slots"], record["first_descriptor"] = index, count, count - 2
    record["contour_offset"], record["contour_count"] = (pool - info) // 4, contours
    record["attachment_count"] = len(fields.kinds)
    directory = data[info + INFO_SECTION.itemsize : pool].view(ATTACHMENT_ENTRY)
    for number, (kind, at, size) in enumerate(places):
        directory["kind"][number], directory["offset"][number], directory["size"][number] = kind, at - info, size
        _write_attachment(fields, layout, number, data[at : at + size], count)
    return data


def attachment_bytes(kind: int, slots: int, values: int) -> int:
    """The size of an attachment."""
    if kind == CONSTANT_COLOR:
        return 8
    if kind in (COLOR_BLOCKS, AMBIENT_BLOCKS):
        return (slots + 1) // 2 * 8
    if kind == NORMAL_BLOCKS:
        return (slots + 1) // 2 * 16
    return (slots + values) * (8 if kind == CORNERS else 4)


def _write_descriptors(fields: Fields, layout: Layout, data: Array, slots: Array, pool: int) -> None:
    contour_at = [0] * len(fields.levels)
    written = 0
    words = data[pool:].view("<u4")
    for level, nodes, slot in layout.groups:
        columns = fields.levels[level]
        for node, at in zip(nodes, range(slot, slot + len(nodes))):
            valid, nonleaf = int(columns.valid[node]), int(columns.nonleaf[node])
            far = int(columns.links[node] >= FAR)
            pointer = layout.pointers.get(at, 0)
            mask = int(columns.contour_masks[node])
            contours = int(POPCOUNT[mask])
            contour_pointer = pool // 4 + written - 2 * at if contours else 0
            if pointer >= 1 << 15 or contour_pointer >= 1 << 24:
                raise ValueError("a pointer does not reach")
            low = pointer << 17 | far << 16 | valid << 8 | (valid & ~nonleaf)
            slots[at] = (contour_pointer << 8 | mask) << 32 | low
            first = contour_at[level]
            words[written : written + contours] = columns.contours[first : first + contours]
            contour_at[level] += contours
            written += contours
    for pointer, _, distance in layout.far:
        slots[pointer] = distance


def _write_outer(
    fields: Fields, layout: Layout, slots: Array, start: int, starts: Callable[[int], Optional[int]]
) -> None:
    for pointer, slot, level, number in layout.outer:
        block = int(fields.levels[level].children[number])
        target = starts(block)
        distance = 0 if target is None else target + 2 - start - slot
        if not 0 < distance < 1 << 32:
            raise ValueError(f"block {block} cannot be reached")
        slots[pointer] = distance


def _write_attachment(fields: Fields, layout: Layout, number: int, data: Array, count: int) -> None:
    kind, constant = fields.kinds[number]
    if kind == CONSTANT_COLOR:
        data[:] = np.frombuffer(constant, np.uint8)
        return
    at = [0] * len(fields.levels)
    written = 0
    if kind in (COLOR_BLOCKS, AMBIENT_BLOCKS, NORMAL_BLOCKS):
        pairs = data.view("<u8").reshape(-1, 2 if kind == NORMAL_BLOCKS else 1)
        for level, nodes, slot in layout.groups:
            some = (len(nodes) + 1) // 2
            values = fields.levels[level].values[number][1].reshape(-1, pairs.shape[1])
            pairs[slot // 2 : slot // 2 + some] = values[at[level] : at[level] + some]
            at[level] += some
        return
    cells: Any = data.view("<u8" if kind == CORNERS else "<u4")
    for level, nodes, slot in layout.groups:
        columns = fields.levels[level]
        masks, values = columns.values[number]
        assert masks is not None
        own = value_counts(kind, masks[nodes.start : nodes.stop], columns.valid[nodes.start : nodes.stop])
        for place, node, some in zip(range(slot, slot + len(nodes)), nodes, own.tolist()):
            first, mask = count + written, int(masks[node])
            if kind == CORNERS:
                cells[place] = (2 * first if some else 0) << 32 | mask
            elif first >= 1 << 24:
                raise ValueError("a plain value is too far away")
            else:
                cells[place] = first << 8 | mask
            cells[first : first + some] = values[at[level] : at[level] + some]
            at[level] += some
            written += some
