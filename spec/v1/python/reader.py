"""A reader of esvo files, version 1, on the parser that is compiled from esvo.ksy.

Written from the specification alone, to be read rather than to be fast. It checks every rule that is a must except
B011, which takes an image of more than 32 GiB, and passes over the two that are a should (B012, A006).
"""

import json
import math
import struct
import zlib

import kaitaistruct
from esvo import Esvo
from kaitaistruct import BytesIO, KaitaiStream

PAGE_SLOTS = 1024
PAGE_BYTES = 8192
NO_PARENT = 0xFFFFFFFF
COLOR_BLOCKS, NORMAL_BLOCKS, CONSTANT_COLOR, AMBIENT_BLOCKS, PLAIN_COLORS, PLAIN_NORMALS, CORNERS = range(1, 8)
WITH_COLORS = {COLOR_BLOCKS, CONSTANT_COLOR, PLAIN_COLORS, CORNERS}
WITH_NORMALS = {NORMAL_BLOCKS, PLAIN_NORMALS, CORNERS}
# The corners of child slot i, in their order, as bits of the lattice of 3 x 3 x 3 points.
CHILD_CORNERS = [
    [
        sum(((i >> axis & 1) + (k >> axis & 1)) * (1, 3, 9)[axis] for axis in range(3))
        for k in range(8)
    ]
    for i in range(8)
]


class Refused(Exception):
    """The file breaks a rule."""

    def __init__(self, rule, what):
        super().__init__(f"{rule}: {what}")
        self.rule = rule


def require(condition, rule, what):
    if not condition:
        raise Refused(rule, what)


def normalised(n):
    """A vector of length 1; +z if it is zero."""
    length = math.sqrt(sum(x * x for x in n))
    return [x / length for x in n] if length else [0.0, 0.0, 1.0]


def raw_normal(w):
    """A point on the cube (section 8.2)."""

    def signed(value, bits):
        value &= (1 << bits) - 1
        return (value - (1 << bits) if value >> bits - 1 else value) / (1 << bits - 1)

    t, u, v = (-1.0 if w >> 31 else 1.0), signed(w, 29), signed(w, 14)
    return {0: (t, u, v), 1: (v, t, u)}.get(w >> 29 & 3, (u, v, t))


def ranges_overlap(ranges):
    """Whether any two of the ranges (start, end) have a byte in common."""
    ordered = sorted(r for r in ranges if r[0] < r[1])
    return any(a[1] > b[0] for a, b in zip(ordered, ordered[1:]))


def only_zeros_outside(data, start, end, ranges):
    """Whether the bytes from start to end that are in none of the ranges are zero."""
    for low, high in sorted(ranges) + [(end, end)]:
        if any(data[start:max(start, low)]):
            return False
        start = max(start, high)
    return True


class Block:
    """A block of the image: the parsed structure and where its parts are."""

    def __init__(self, entry, index, image):
        self.entry, self.index, self.bytes = entry, index, image
        self.start = entry.image_offset // 8
        self.claimed = set()
        self.described = set()
        self.contours_used = set()
        size = len(image)
        require(size >= 8, "P001", f"block {index} has no page header")
        self.array = struct.unpack_from("<Q", image)[0]
        require(4 <= self.array <= size // 8, "P001", f"block {index}: first page header {self.array:#x}")
        self.info_at = self.array * 8
        require(self.info_at + 32 <= size, "P002", f"block {index}: the info section does not fit")
        count = struct.unpack_from("<I", image, self.info_at + 20)[0]
        require(count <= 64, "A004", f"block {index}: {count} attachments")
        require(self.info_at + 32 + 16 * count <= size, "P002", f"block {index}: the attachments do not fit")
        self.parsed = Esvo.BlockImage(KaitaiStream(BytesIO(image)))
        self.slots = self.parsed.slots
        self.info = self.parsed.info
        self.check_info(size)
        self.check_attachments(size)
        self.pool = self.parsed.contours
        require(all(c.word & 0x3FFFF for c in self.pool), "K004", f"block {index}: a contour without a normal")
        parts = [(0, self.info_at), (self.info_at, self.info_at + 32 + 16 * count), (self.pool_at, self.pool_end)]
        parts += [(a.at, a.at + a.size) for a in self.info.attachments]
        require(only_zeros_outside(image, 0, size, parts), "P006", f"block {index}: bytes between its parts")
        for page in range(0, self.array, PAGE_SLOTS):
            header = self.slots[page].page_header
            fits = header.slots == self.array - page and header.zero == 0
            require(fits, "P001", f"block {index}: page header of slot {page}")

    def check_info(self, size):
        info, index = self.info, self.index
        require(info.block == index, "P003", f"the info section of block {index} says {info.block}")
        require(info.array_slots == self.array, "P002", f"block {index}: {info.array_slots} slots")
        require(info.first_descriptor == self.array - 2, "P004", f"block {index}: {info.first_descriptor}")
        require(info.reserved == 0, "P006", f"block {index}: reserved field of the info section")
        self.pool_at = self.info_at + 4 * info.contour_offset
        self.pool_end = self.pool_at + 4 * info.contour_count
        directory_end = self.info_at + 32 + 16 * info.attachment_count
        require(directory_end <= self.pool_at and self.pool_end <= size, "P005", f"block {index}: contour pool")

    def check_attachments(self, size):
        entries = self.info.attachments
        pairs = (self.array + 1) // 2
        sizes = {COLOR_BLOCKS: 8 * pairs, NORMAL_BLOCKS: 16 * pairs, CONSTANT_COLOR: 8, AMBIENT_BLOCKS: 8 * pairs}
        units = {PLAIN_COLORS: 4, PLAIN_NORMALS: 4, CORNERS: 8}
        self.attachments = {}
        for entry in entries:
            name = f"block {self.index}: attachment {entry.kind}"
            known = entry.kind in sizes or entry.kind in units
            require(known or 0x8000 <= entry.kind <= 0xFFFF, "A002", f"{name} is not registered")
            require(entry.kind not in self.attachments, "A002", f"{name} occurs twice")
            require(entry.size == sizes.get(entry.kind, entry.size), "A003", f"{name} has {entry.size} bytes")
            unit = units.get(entry.kind, 1)
            enough = entry.kind not in units or entry.size >= unit * self.array
            require(enough and entry.size % unit == 0, "A003", f"{name} has {entry.size} bytes")
            inside = self.pool_end <= entry.at and entry.at + entry.size <= size
            require(inside and entry.at % 8 == 0, "A001", f"{name} at {entry.at}")
            self.attachments[entry.kind] = entry
        for what, kinds in (("colours", WITH_COLORS), ("normals", WITH_NORMALS)):
            several = len(kinds & self.attachments.keys()) > 1
            require(not several, "A002", f"block {self.index} has several types with {what}")
        require(not ranges_overlap([(e.at, e.at + e.size) for e in entries]), "A001", "attachments overlap")
        if CONSTANT_COLOR in self.attachments:
            unused = self.attachments[CONSTANT_COLOR].constant_color.zero
            require(not any(unused), "A005", f"block {self.index}: unused bytes of the constant colour")

    def check_unused(self):
        """What can be said once every pointer has been followed."""
        for slot in range(self.array):
            free = slot % PAGE_SLOTS != 0 and slot not in self.claimed
            if free:
                empty = not any(self.bytes[8 * slot:8 * slot + 8])
                require(empty, "P006", f"block {self.index}: unused slot {slot}")
        unused = self.info.contour_count - len(self.contours_used)
        require(unused == 0, "K005", f"block {self.index}: {unused} contours belong to no voxel")
        used = {slot // 2 for slot in self.described}
        for kind in (PLAIN_COLORS, PLAIN_NORMALS, CORNERS):
            if kind in self.attachments:
                self.check_entries(kind)
        for kind, unit in ((COLOR_BLOCKS, 8), (NORMAL_BLOCKS, 16), (AMBIENT_BLOCKS, 8)):
            if kind in self.attachments:
                body = self.attachments[kind].body
                for pair in range(len(body) // unit):
                    empty = not any(body[unit * pair:unit * (pair + 1)])
                    require(pair in used or empty, "A005", f"block {self.index}: values for pair {pair}")

    def check_entries(self, kind):
        """Every descriptor has values of its own, every value a descriptor."""
        entry = self.attachments[kind]
        name = f"block {self.index}: attachment {kind}"
        unit = 2 if kind == CORNERS else 1
        words = struct.unpack(f"<{entry.size // 4}I", entry.body)
        used = set()
        for slot in range(self.array):
            own = words[unit * slot:unit * slot + unit]
            if slot not in self.described:
                require(not any(own), "A005", f"{name} has an entry for slot {slot}")
                continue
            if kind == CORNERS:
                parsed = entry.corners.entries[slot]
                count = 2 * (parsed.mask.bit_count() + 8 * parsed.own_corners)
                fits = parsed.zero == 0 and (count or parsed.first == 0)
            else:
                parsed = entry.plain.entries[slot]
                valid = self.slots[slot].descriptor.valid_mask
                count = parsed.mask.bit_count() + (valid & ~parsed.mask != 0)
                fits = parsed.mask & ~valid == 0
            inside = not count or unit * self.array <= parsed.first and parsed.first + count <= len(words)
            require(fits and inside, "A007", f"{name}, slot {slot}")
            values = range(parsed.first, parsed.first + count)
            require(used.isdisjoint(values), "A008", f"{name}, slot {slot}: values of another")
            used.update(values)
        require(len(used) == len(words) - unit * self.array, "A008", f"{name}: values that belong to no descriptor")

    def plain_value(self, kind, slot, child):
        """The word of a voxel in plain colours or normals (section 8.5), or None."""
        if kind not in self.attachments:
            return None
        plain = self.attachments[kind].plain
        entry = plain.entries[slot]
        below = (1 << child) - 1 if entry.mask >> child & 1 else 0xFF
        at = entry.first + (entry.mask & below).bit_count() - self.array
        # Behind the values there is nothing; entries are checked once all descriptors are known.
        return plain.values[at] if 0 <= at < len(plain.values) else None

    def cell(self, slot, child):
        """Values at the corners of a voxel or of the one above, and whether they are its own (section 8.6), or None."""
        if CORNERS not in self.attachments:
            return None
        corners = self.attachments[CORNERS].corners
        entry = corners.entries[slot]
        first = entry.first // 2 - self.array
        bits = CHILD_CORNERS[child]
        own = all(entry.mask >> bit & 1 for bit in bits)
        if not own and not entry.own_corners:
            return None
        ranks = [(entry.mask & (1 << bit) - 1).bit_count() for bit in bits]
        if not own:
            ranks = [entry.mask.bit_count() + k for k in range(8)]
        if first < 0 or first + max(ranks) >= len(corners.values):
            return None
        return [corners.values[first + rank] for rank in ranks], own

    def middle(self, slot, child):
        """Colour and normal of the middle of a voxel by its corners (section 8.6), or None."""
        found = self.cell(slot, child)
        if found is None:
            return None
        values, own = found
        q = [0.5 if own else ((child >> axis & 1) + 0.5) / 2 for axis in range(3)]
        total, color, normal = 0.0, [0.0] * 4, [0.0] * 3
        for k, value in enumerate(values):
            weight = math.prod(q[axis] if k >> axis & 1 else 1 - q[axis] for axis in range(3))
            if value.alpha == 0:
                continue
            total += weight
            for c, channel in enumerate((value.red, value.green, value.blue, value.alpha)):
                color[c] += weight * channel / 255
            for c, component in enumerate(normalised(raw_normal(value.normal))):
                normal[c] += weight * component
        if total == 0:
            return None
        return [c / total for c in color[:3]], normalised(normal)

    def ambient(self, slot, child):
        """What of the light from all around reaches a voxel (section 8.4), or None."""
        if AMBIENT_BLOCKS not in self.attachments:
            return None
        block = self.attachments[AMBIENT_BLOCKS].ambient.pairs[slot // 2]
        k = block.weights[child + 8 * (slot % 2)]
        ref0 = block.ref0 + block.ref1 / 256
        return min((k * ref0 + (7 - k) * block.ref1) / (7 * 255), 1.0)

    def attributes(self, slot, child):
        """What a voxel has, by the names in the JSON."""
        found = {"color": self.color(slot, child), "normal": self.normal(slot, child)}
        color = self.plain_value(PLAIN_COLORS, slot, child)
        if color is not None:
            found["color"], found["alpha"] = [(color >> shift & 255) / 255 for shift in (0, 8, 16)], color >> 24
        normal = self.plain_value(PLAIN_NORMALS, slot, child)
        if normal is not None:
            found["normal"] = normalised(raw_normal(normal))
        cell = self.cell(slot, child)
        if cell is not None:
            found["own_corners"] = cell[1]
            found["corners"] = [[v.red, v.green, v.blue, v.alpha, v.normal] for v in cell[0]]
            found["color"], found["normal"] = self.middle(slot, child) or (None, None)
        found["ambient"] = self.ambient(slot, child)
        return {name: value for name, value in found.items() if value is not None}

    def color(self, slot, child):
        """Colour of a voxel (section 8.1, 8.3), or None."""
        if CONSTANT_COLOR in self.attachments:
            c = self.attachments[CONSTANT_COLOR].constant_color
            return [c.red / 255, c.green / 255, c.blue / 255]
        if COLOR_BLOCKS not in self.attachments:
            return None
        block = self.attachments[COLOR_BLOCKS].colors.pairs[slot // 2]
        a, b = (block.red0, block.green0, block.blue0), (block.red1, block.green1, block.blue1)
        weights = ((1, 0), (0, 1), (2 / 3, 1 / 3), (1 / 3, 2 / 3))
        wa, wb = weights[block.indices[child + 8 * (slot % 2)]]
        return [wa * x + wb * y for x, y in zip(a, b)]

    def normal(self, slot, child):
        """Normal of a voxel (section 8.2), or None."""
        if NORMAL_BLOCKS not in self.attachments:
            return None
        block = self.attachments[NORMAL_BLOCKS].normals.pairs[slot // 2]
        t = -1.0 if block.negative else 1.0
        u, v = block.u, block.v
        base = {0: (t, u, v), 1: (v, t, u)}.get(block.main_axis, (u, v, t))
        grid = (-1, -1 / 3, 1 / 3, 1)
        texel = child + 8 * (slot % 2)
        cu, cv = grid[block.u_indices[texel]], grid[block.v_indices[texel]]
        u_axis, v_axis = self.axis(block.axes << 16 & 0xFFFFFFFF), self.axis(block.axes)
        n = [p + cu * a + cv * b for p, a, b in zip(base, u_axis, v_axis)]
        return normalised(n)

    @staticmethod
    def axis(half):
        """The axis vector in the upper half of a word, the lower half being fractions."""
        scale = 2.0 ** ((half >> 16 & 15) - 41)

        def signed(word):
            word &= 0xFFFFFFFF
            return word - (1 << 32) if word >> 31 else word

        return [signed(half << shift) * scale for shift in (0, 4, 8)]


class Reader:
    """A file, checked; `objects` has the decoded octrees."""

    def __init__(self, data):
        self.data = data
        self.read_header()
        self.read_directory()
        self.read_tables()
        self.blocks = [Block(e, i, self.block_bytes(e, i)) for i, e in enumerate(self.block_entries)]
        self.starts = [block.start for block in self.blocks]
        self.entered = set()
        self.objects = [self.walk(index, entry) for index, entry in enumerate(self.object_entries)]
        for index, block in enumerate(self.blocks):
            require(index in self.entered, "B010", f"nothing refers to block {index}")
            block.check_unused()

    def read_header(self):
        try:
            self.file = Esvo(KaitaiStream(BytesIO(self.data)))
        except kaitaistruct.ValidationNotEqualError as error:
            raise Refused("H001" if error.src_path.endswith("seq/0") else "H002", str(error)) from error
        except EOFError as error:
            raise Refused("H001", "too short for a header") from error
        h = self.header = self.file.header
        require(zlib.crc32(self.data[:60]) == h.header_crc, "H005", "the header is damaged")
        require(h.required_features & ~1 == 0, "H003", f"features {h.required_features:#x}")
        require(h.file_length == len(self.data), "H004", f"{len(self.data)} bytes, not {h.file_length}")
        require(h.reserved == 0, "H006", "reserved bytes of the header")

    def read_directory(self):
        h, size = self.header, len(self.data)
        at, end = h.directory_offset, h.directory_offset + 32 * h.directory_count
        require(64 <= at and end <= size and at % 8 == 0, "D001", f"directory at {at}")
        require(h.directory_count <= 1024, "D008", f"{h.directory_count} sections")
        require(zlib.crc32(self.data[at:end]) == h.directory_crc, "D002", "the directory is damaged")
        self.sections = self.file.directory
        ranges = [(0, 64), (at, end)]
        tags = [s.tag for s in self.sections]
        for s in self.sections:
            require(s.flags & ~3 == 0 and s.reserved == 0, "D007", f"section {s.tag}")
            require(s.offset % 8 == 0 and s.offset + s.length <= size, "D003", f"section {s.tag} at {s.offset}")
            ranges.append((s.offset, s.offset + s.length))
            crc = 0 if s.own_checksums else zlib.crc32(s.body)
            require(crc == s.crc, "D004", f"section {s.tag} is damaged")
            known = s.tag in (b"OBJT", b"BLKT", b"BLKS", b"META")
            require(known or not s.required, "D005", f"section {s.tag} is required")
        for tag in (b"OBJT", b"BLKT", b"BLKS"):
            require(tags.count(tag) == 1, "D006", f"section {tag}")
        require(len(set(tags)) == len(tags), "D006", "a section occurs twice")
        require(not ranges_overlap(ranges), "D003", "sections overlap")
        require(only_zeros_outside(self.data, 0, size, ranges), "D009", "bytes between sections")
        self.section = {s.tag: s for s in self.sections}
        self.meta = None
        if b"META" in self.section:
            try:
                self.meta = json.loads(self.section[b"META"].metadata)
            except ValueError as error:
                raise Refused("M001", str(error)) from error
            require(isinstance(self.meta, dict), "M001", "not an object")

    def read_tables(self):
        objects, blocks = self.section[b"OBJT"], self.section[b"BLKT"]
        require(objects.length and objects.length % 192 == 0, "O001", f"{objects.length} bytes")
        require(blocks.length and blocks.length % 72 == 0, "B001", f"{blocks.length} bytes")
        self.object_entries = objects.objects.entries
        self.block_entries = blocks.blocks.entries
        for index, o in enumerate(self.object_entries):
            require(usable_transform(o.octree_to_mesh), "O004", f"object {index}")
            require(1 <= o.levels <= 23, "O003", f"object {index}: {o.levels} levels")
            require(not any(o.reserved), "O006", f"object {index}")
        end = 0
        for index, b in enumerate(self.block_entries):
            self.check_block_entry(index, b, end)
            end += b.image_size
        self.check_stored(end)

    def check_block_entry(self, index, b, end):
        name = f"block {index}"
        aligned = b.image_offset % PAGE_BYTES == 0 and b.image_size % PAGE_BYTES == 0 and b.image_size
        require(aligned, "B002", name)
        require(b.image_offset == end, "B003", f"{name} at {b.image_offset}, not {end}")
        require(b.reserved == 0, "B009", name)
        require(1 <= b.cube_scale <= 23, "B008", f"{name}: scale {b.cube_scale}")
        edge = 1 << b.cube_scale
        if b.parent == NO_PARENT:
            fits = b.object < len(self.object_entries) and self.object_entries[b.object].root_block == index
            require(fits, "B007", f"{name} has no parent and is no root block")
            corner, outer = [0, 0, 0], 1 << 23
        else:
            fits = b.parent < index and self.block_entries[b.parent].object == b.object
            require(fits, "B007", f"{name}: parent {b.parent}")
            parent = self.block_entries[b.parent]
            corner, outer = parent.cube_position, 1 << parent.cube_scale
        inside = all(x % edge == 0 and c <= x and x + edge <= c + outer for x, c in zip(b.cube_position, corner))
        require(inside, "B008", f"{name}: cube {b.cube_position}, scale {b.cube_scale}")

    def check_stored(self, image_size):
        data = self.section[b"BLKS"]
        known = (Esvo.Codec.raw, Esvo.Codec.zstandard)
        for index, b in enumerate(self.block_entries):
            require(b.codec in known, "B005", f"block {index}: codec {b.codec}")
            allowed = b.codec == Esvo.Codec.raw or self.header.required_features & 1
            require(allowed, "B005", f"block {index} is compressed, the header does not say so")
            exact = b.codec != Esvo.Codec.raw or b.stored_size == b.image_size
            require(exact, "B005", f"block {index}: {b.stored_size} bytes stored")
            inside = data.offset <= b.file_offset and b.file_offset + b.stored_size <= data.offset + data.length
            require(inside and b.file_offset % PAGE_BYTES == 0, "B004", f"block {index} at {b.file_offset}")
        stored = [(b.file_offset, b.file_offset + b.stored_size) for b in self.block_entries]
        require(not ranges_overlap(stored), "B004", "blocks overlap")
        if all(b.codec == Esvo.Codec.raw for b in self.block_entries):
            as_image = all(b.file_offset == data.offset + b.image_offset for b in self.block_entries)
            require(as_image, "B004", "blocks are not in the order of the image")
            require(image_size == data.length, "B003", f"{image_size} bytes of blocks in {data.length}")

    def block_bytes(self, b, index):
        require(zlib.crc32(b.stored) == b.crc, "B006", f"block {index} is damaged")
        if b.codec == Esvo.Codec.raw:
            return b.stored
        import zstandard  # Only compressed files need it.

        try:
            unpacker = zstandard.ZstdDecompressor(max_window_size=1 << 27)
            image = unpacker.decompress(b.stored, max_output_size=b.image_size, read_across_frames=False)
        except (zstandard.ZstdError, MemoryError) as error:
            raise Refused("B005", f"block {index}: {error}") from error
        require(len(image) == b.image_size, "B005", f"block {index}: {len(image)} bytes unpacked")
        padding = self.data[b.file_offset + b.stored_size:b.file_offset + -(-b.stored_size // PAGE_BYTES) * PAGE_BYTES]
        require(not any(padding), "B005", f"block {index}: bytes behind the frame")
        return image

    def walk(self, index, o):
        """The descriptors of an object in the order of their paths."""
        found = o.root_block < len(self.blocks) and self.blocks[o.root_block]
        is_root = found and found.entry.object == index and found.entry.parent == NO_PARENT
        require(is_root and o.root_slot == found.start + 2, "O002", f"object {index}: root slot {o.root_slot}")
        self.entered.add(o.root_block)
        self.claim(found, 2, 1)
        counts = {"descriptors": 0, "leaf_voxels": 0, "contours": 0, "far_pointers": 0}
        nodes, deepest = [], 0
        stack = [(found, 2, "", (0, 0, 0))]
        while stack:
            block, slot, path, position = stack.pop()
            level = len(path)
            d = block.slots[slot].descriptor
            name = f"slot {slot} of block {block.index}"
            require(d.leaf_mask & ~d.valid_mask == 0 and d.valid_mask, "C001", name)
            require(level + 1 <= o.levels, "C007", name)
            deepest = max(deepest, level + 1)
            block.described.add(slot)
            voxels = self.voxels(block, slot, d, name)
            counts["descriptors"] += 1
            counts["leaf_voxels"] += d.leaf_mask.bit_count()
            counts["contours"] += d.contour_mask.bit_count()
            counts["far_pointers"] += d.far
            nodes.append({
                "path": path, "level": level, "position": list(position), "block": block.index, "slot": slot,
                "valid": d.valid_mask, "leaf": d.leaf_mask, "contours": d.contour_mask, "far": bool(d.far),
                "voxels": voxels,
            })
            children = [child for child in range(8) if d.nonleaf_mask >> child & 1]
            if not children:
                require(d.child_pointer == 0 and not d.far, "C006", name)
                continue
            below, first = self.first_child(block, slot, d, len(children), name)
            if below is not block:
                cube = (tuple(below.entry.cube_position), below.entry.cube_scale)
                require(cube == (position, 23 - level), "B008", f"block {below.index} is below another cube")
                self.entered.add(below.index)
            half = 1 << (22 - level)
            for rank, child in reversed(list(enumerate(children))):
                corner = tuple(x + half * (child >> axis & 1) for axis, x in enumerate(position))
                stack.append((below, first + rank, path + str(child), corner))
        require(deepest == o.levels, "O003", f"object {index}: {deepest} levels, not {o.levels}")
        for what, count in counts.items():
            require(getattr(o, what) == count, "O005", f"object {index}: {count} {what}")
        return {"octree_to_mesh": o.octree_to_mesh, "levels": o.levels, **counts, "nodes": nodes}

    def voxels(self, block, slot, d, name):
        require(d.contour_mask & ~d.valid_mask == 0, "K001", name)
        require(d.contour_mask or d.contour_pointer == 0, "K003", name)
        # Place in the pool of the first contour.
        first = slot * 2 + d.contour_pointer - block.pool_at // 4
        count = d.contour_mask.bit_count()
        require(not count or 0 <= first and first + count <= len(block.pool), "K002", name)
        own = set(range(first, first + count))
        require(not own & block.contours_used, "K005", name)
        block.contours_used |= own
        voxels = []
        for child in (child for child in range(8) if d.valid_mask >> child & 1):
            voxel = {"slot": child, "leaf": bool(d.leaf_mask >> child & 1)}
            if d.contour_mask >> child & 1:
                c = block.pool[first]
                first += 1
                normal = [c.nx, c.ny, c.nz]
                voxel["contour"] = {
                    "word": c.word, "normal": normal, "position": c.position, "thickness": c.thickness,
                }
            voxel.update(block.attributes(slot, child))
            voxels.append(voxel)
        return voxels

    def claim(self, block, first, count):
        """Slots get the one purpose that they can have."""
        in_page = first % PAGE_SLOTS
        require(in_page != 0 and in_page + count <= PAGE_SLOTS, "C003", f"slot {first} of block {block.index}")
        for slot in range(first, first + count):
            require(slot not in block.claimed, "C005", f"slot {slot} of block {block.index}")
            block.claimed.add(slot)

    def first_child(self, block, slot, d, count, name):
        near = slot + d.child_pointer
        inside = d.child_pointer != 0 and near < block.array
        require(inside, "C004" if d.far else "C002", name)
        below, first = block, near
        if d.far:
            self.claim(block, near, 1)
            far = block.slots[near].far_pointer
            require(far.slots and far.zero == 0, "C004", name)
            first = slot + far.slots
            if first >= block.array:
                target = block.start + first
                found = [b for b in self.blocks if b.start <= target < b.start + b.entry.image_size // 8]
                require(found and found[0] is not block, "C002", name)
                below, first = found[0], target - found[0].start
                require(first == 2 and below.entry.parent == block.index, "C008", name)
        require(first + count <= below.array, "C002", name)
        require(first % 2 == 0, "C003", name)
        self.claim(below, first, count)
        return below, first


def usable_transform(m):
    """Whether it is finite, affine, and has a determinant that is a normal number."""
    if not all(map(math.isfinite, m)) or [m[3], m[7], m[11], m[15]] != [0, 0, 0, 1]:
        return False
    determinant = (
        m[0] * (m[5] * m[10] - m[9] * m[6])
        - m[4] * (m[1] * m[10] - m[9] * m[2])
        + m[8] * (m[1] * m[6] - m[5] * m[2])
    )
    return math.isfinite(determinant) and abs(determinant) >= 2.0**-1022
