"""Codec 2: blocks as streams of fields (section 4.4)."""

from __future__ import annotations

from typing import Callable, Iterator, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from . import kinds
from .records import POPCOUNT, Array

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
    kinds.COLOR_BLOCKS: 10,
    kinds.NORMAL_BLOCKS: 18,
    kinds.CONSTANT_COLOR: 0,
    kinds.AMBIENT_BLOCKS: 8,
    kinds.PLAIN_COLORS: 5,
    kinds.PLAIN_NORMALS: 6,
    kinds.CORNERS: 13,
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

    def cut(self) -> None:
        """Makes leaves of the children of the last level that was read, but for those in other blocks."""
        level = self.levels[-1]
        gone = (level.links == NEAR) | (level.links == FAR)
        nonleaf, links = level.nonleaf.copy(), level.links.copy()
        nonleaf[gone], links[gone] = 0, NONE
        self.levels[-1] = level._replace(nonleaf=nonleaf, links=links)

    def entered(self) -> Iterator[Tuple[int, int]]:
        """The blocks that links lead to, and which children of the descriptor are there, as a mask."""
        for level in self.levels:
            yield from zip(level.children.tolist(), level.nonleaf[level.links == BLOCK].tolist())

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
            self.kinds.append((kind, rest.take(8) if kind == kinds.CONSTANT_COLOR else b""))

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
                    values.append((None, column[at] if kind != kinds.CONSTANT_COLOR else column))
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
        if kind == kinds.CONSTANT_COLOR:
            return None, np.zeros(0, np.uint64)
        if kind == kinds.NORMAL_BLOCKS:
            return None, read_rows(pairs, streams)
        if kind in (kinds.COLOR_BLOCKS, kinds.AMBIENT_BLOCKS):
            low = streams.words(pairs, COLOR_HEAD if kind == kinds.COLOR_BLOCKS else BYTES)
            return None, slots_of(low, streams.words(pairs, BYTES))
        if kind == kinds.CORNERS:
            mask = streams.words(len(valid), BYTES)
            count = int(value_counts(kind, mask, valid).sum())
            self._check_values(8 * count)
            low = streams.words(count, BYTES)
            return mask, slots_of(low, streams.words(count, BASE))
        mask = streams.next(len(valid))
        count = int(value_counts(kind, mask, valid).sum())
        self._check_values(4 * count)
        return mask, streams.words(count, BASE if kind == kinds.PLAIN_NORMALS else BYTES)

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
    if kind == kinds.CORNERS:
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
