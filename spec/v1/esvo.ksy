# The layout of version 1 for programs; README.md in this folder is the specification, section numbers refer to it.
# What a slot of a descriptor array is depends on what refers to it, so a slot offers all its views and a reader that
# walks the octree picks one. Compressed blocks (codec 1) have to be decompressed and given to block_image by the reader.
meta:
  id: esvo
  title: esvo sparse voxel octree, version 1
  file-extension: esvo
  endian: le
  bit-endian: le
  license: CC0-1.0
doc: Sparse voxel octrees as a ray caster reads them - blocks of child descriptors, contours and attachments.
seq:
  - id: header
    type: header
instances:
  directory:
    pos: header.directory_offset
    type: section_entry
    repeat: expr
    repeat-expr: header.directory_count
    doc: Section 2.2.
types:
  header:
    doc: Section 2.1, 64 bytes.
    seq:
      - id: identifier
        contents: [0xab, "ESVO 1", 0xbb, 0x0d, 0x0a, 0x1a, 0x0a]
      - id: major
        type: u2
        valid: 1
      - id: minor
        type: u2
      - id: required_features
        type: u8
      - id: optional_features
        type: u8
      - id: file_length
        type: u8
      - id: directory_offset
        type: u8
      - id: directory_count
        type: u4
      - id: directory_crc
        type: u4
      - id: head
        type: u4
        doc: Length in bytes of the head; section 4.5.
      - id: header_crc
        type: u4
  section_entry:
    doc: Section 2.2, 32 bytes.
    seq:
      - id: tag
        size: 4
      - id: flags
        type: u4
      - id: offset
        type: u8
      - id: length
        type: u8
      - id: crc
        type: u4
      - id: reserved
        type: u4
    instances:
      required:
        value: (flags & 1) != 0
      own_checksums:
        value: (flags & 2) != 0
      body:
        io: _root._io
        pos: offset
        size: length
      objects:
        io: _root._io
        pos: offset
        size: length
        type: object_table
        if: tag == [0x4f, 0x42, 0x4a, 0x54]
      blocks:
        io: _root._io
        pos: offset
        size: length
        type: block_table
        if: tag == [0x42, 0x4c, 0x4b, 0x54]
      parts:
        io: _root._io
        pos: offset
        size: length
        type: part_table
        if: tag == [0x50, 0x41, 0x52, 0x54]
      metadata:
        io: _root._io
        pos: offset
        size: length
        type: str
        encoding: UTF-8
        if: tag == [0x4d, 0x45, 0x54, 0x41]
  object_table:
    doc: Section 3.
    seq:
      - id: entries
        type: object_entry
        repeat: eos
  object_entry:
    doc: 192 bytes.
    seq:
      - id: octree_to_mesh
        type: f8
        repeat: expr
        repeat-expr: 16
        doc: By columns, for column vectors.
      - id: root_block
        type: u4
      - id: levels
        type: u4
      - id: root_slot
        type: u8
      - id: descriptors
        type: u8
      - id: leaf_voxels
        type: u8
      - id: contours
        type: u8
      - id: far_pointers
        type: u8
      - id: reserved
        size: 16
  block_table:
    doc: Section 4.1.
    seq:
      - id: entries
        type: block_entry
        repeat: eos
  block_entry:
    doc: 72 bytes.
    seq:
      - id: object
        type: u4
      - id: parent
        type: u4
        doc: 0xffffffff for root blocks.
      - id: cube_position
        type: u4
        repeat: expr
        repeat-expr: 3
        doc: In units of 2^-23 of the root cube.
      - id: cube_scale
        type: u4
      - id: image_offset
        type: u8
      - id: image_size
        type: u8
      - id: file_offset
        type: u8
      - id: stored_size
        type: u8
      - id: codec
        type: u4
        enum: codec
      - id: crc
        type: u4
      - id: reserved
        type: u8
    instances:
      stored:
        io: _root._io
        pos: file_offset
        size: stored_size
      image:
        io: _root._io
        pos: file_offset
        size: stored_size
        type: block_image
        if: codec == codec::raw and (_root.header.required_features & 2) == 0
  part_table:
    doc: Section 4.3; with required feature bit 1. The parts lie in BLKS in this order, each from a multiple of 8 bytes.
    seq:
      - id: entries
        type: part_entry
        repeat: eos
  part_entry:
    doc: 12 bytes.
    seq:
      - id: block
        type: u4
      - id: size
        type: u4
        doc: With the part header.
      - id: first_level
        type: u1
      - id: last_level
        type: u1
      - id: reserved
        type: u2
  part_header:
    doc: Section 4.3; 16 bytes that every part begins with.
    seq:
      - id: crc
        type: u4
      - id: size
        type: u4
      - id: block
        type: u4
      - id: first_level
        type: u1
      - id: last_level
        type: u1
      - id: codec
        type: u1
      - id: reserved
        type: u1
  block_image:
    doc: Section 4.2; a block as it is in memory. The root of a stream where the block was compressed.
    seq:
      - id: array_slots
        type: u4
        doc: The low word of the first page header; its high word is zero.
      - id: zero
        type: u4
    instances:
      slots:
        pos: 0
        size: 8
        type: slot
        repeat: expr
        repeat-expr: array_slots
        doc: The descriptor array.
      info:
        pos: array_slots * 8
        type: info_section(array_slots * 8)
      contours:
        pos: info.at + info.contour_offset * 4
        type: contour
        repeat: expr
        repeat-expr: info.contour_count
        doc: The contour pool.
  slot:
    doc: 8 bytes; what they are is decided by what refers to them.
    instances:
      page_header:
        pos: 0
        type: distance
        doc: Distance in slots to the info section.
      far_pointer:
        pos: 0
        type: distance
        doc: Distance in slots from the descriptor to its first child.
      descriptor:
        pos: 0
        type: child_descriptor
  distance:
    seq:
      - id: slots
        type: u4
      - id: zero
        type: u4
  child_descriptor:
    doc: Section 5.
    seq:
      - id: leaf_mask
        type: u1
      - id: valid_mask
        type: u1
      - id: far
        type: b1
      - id: child_pointer
        type: b15
      - id: contour_mask
        type: u1
      - id: contour_pointer
        type: b24
    instances:
      nonleaf_mask:
        value: valid_mask & (0xff ^ leaf_mask)
  info_section:
    doc: Section 6.
    params:
      - id: at
        type: u8
        doc: Where it lies in the block, in bytes.
    seq:
      - id: block
        type: u4
      - id: array_slots
        type: u4
      - id: first_descriptor
        type: u4
      - id: contour_offset
        type: u4
      - id: contour_count
        type: u4
      - id: attachment_count
        type: u4
      - id: reserved
        type: u8
      - id: attachments
        type: attachment_entry(at)
        repeat: expr
        repeat-expr: attachment_count
  attachment_entry:
    params:
      - id: info_at
        type: u8
    seq:
      - id: kind
        type: u4
        doc: Names are in the enumeration attachment; 0x8000 to 0xffff are those of vendors.
      - id: offset
        type: u4
      - id: size
        type: u8
    instances:
      at:
        value: info_at + offset
        doc: Where the attachment starts in the block, in bytes.
      body:
        pos: at
        size: size
      colors:
        pos: at
        size: size
        type: color_blocks
        if: kind == 1
      normals:
        pos: at
        size: size
        type: normal_blocks
        if: kind == 2
      constant_color:
        pos: at
        size: size
        type: constant_color
        if: kind == 3
      ambient:
        pos: at
        size: size
        type: ambient_blocks
        if: kind == 4
      plain:
        pos: at
        size: size
        type: plain_values(_parent.array_slots)
        if: kind == 5 or kind == 6
      corners:
        pos: at
        size: size
        type: corner_values(_parent.array_slots)
        if: kind == 7
      components:
        pos: at
        size: size
        type: component_values(_parent.array_slots)
        if: (kind >= 8 and kind <= 11) or (kind >= 16 and kind <= 31)
  contour:
    doc: Section 7. Every field is decoded with all bits below it; numbers are exact in binary64.
    seq:
      - id: word
        type: u4
    instances:
      low18:
        value: word & 0x3ffff
      low12:
        value: word & 0xfff
      low6:
        value: word & 0x3f
      low25:
        value: word & 0x1ffffff
      nx:
        value: '(low18 >= 0x20000 ? low18 - 0x40000 : low18) / 4096.0'
      ny:
        value: '(low12 >= 0x800 ? low12 - 0x1000 : low12) / 64.0'
      nz:
        value: '(low6 >= 0x20 ? low6 - 0x40 : low6) / 1.0'
      position:
        value: '(low25 >= 0x1000000 ? low25 - 0x2000000 : low25) * 0.75 / 262144.0'
      thickness:
        value: word * 0.75 / 33554432.0
  color_blocks:
    doc: Section 8.1; one for every pair of slots.
    seq:
      - id: pairs
        type: color_block
        repeat: eos
  color_block:
    seq:
      - id: head
        type: u4
      - id: indices
        type: b2
        repeat: expr
        repeat-expr: 16
    instances:
      red0:
        value: (head & 0xffff) / 65536.0
        doc: The references with the bits below each channel.
      green0:
        value: (head & 0x7ff) / 2048.0
      blue0:
        value: (head & 0x1f) / 32.0
      red1:
        value: head / 4294967296.0
      green1:
        value: (head & 0x7ffffff) / 134217728.0
      blue1:
        value: (head & 0x1fffff) / 2097152.0
  normal_blocks:
    doc: Section 8.2; one for every pair of slots.
    seq:
      - id: pairs
        type: normal_block
        repeat: eos
  normal_block:
    seq:
      - id: base
        type: u4
      - id: u_indices
        type: b2
        repeat: expr
        repeat-expr: 16
      - id: axes
        type: u4
      - id: v_indices
        type: b2
        repeat: expr
        repeat-expr: 16
    instances:
      negative:
        value: (base & 0x80000000) != 0
      main_axis:
        value: (base / 0x20000000) & 3
      u_bits:
        value: base & 0x1fffffff
      v_bits:
        value: base & 0x3fff
      u:
        value: '(u_bits >= 0x10000000 ? u_bits - 0x20000000 : u_bits) / 268435456.0'
      v:
        value: '(v_bits >= 0x2000 ? v_bits - 0x4000 : v_bits) / 8192.0'
  constant_color:
    doc: Section 8.3.
    seq:
      - id: red
        type: u1
      - id: green
        type: u1
      - id: blue
        type: u1
      - id: zero
        size: 5
  ambient_blocks:
    doc: Section 8.4; one for every pair of slots.
    seq:
      - id: pairs
        type: ambient_block
        repeat: eos
  ambient_block:
    seq:
      - id: ref1
        type: u1
      - id: ref0
        type: u1
        doc: The bits of ref1 are its fraction.
      - id: weights
        type: b3
        repeat: expr
        repeat-expr: 16
  plain_values:
    doc: Section 8.5; what the values are, colours or raw normals, the type of the attachment says.
    params:
      - id: slots
        type: u4
    seq:
      - id: entries
        type: plain_entry
        repeat: expr
        repeat-expr: slots
      - id: values
        type: u4
        repeat: eos
  plain_entry:
    seq:
      - id: mask
        type: u1
      - id: first
        type: b24
        doc: Words from the start of the attachment.
  component_values:
    doc: Section 8.7; how many words a value has follows from count and number.
    params:
      - id: slots
        type: u4
    seq:
      - id: head
        type: component_head
      - id: entries
        type: plain_entry
        repeat: expr
        repeat-expr: 'head.form == 0 ? slots : 0'
      - id: values
        type: u4
        repeat: eos
  component_head:
    seq:
      - id: count
        type: u1
      - id: number
        type: u1
        enum: number_format
      - id: form
        type: u1
        doc: 0 for entries and values, 1 for one value of all voxels.
      - id: zero
        size: 5
  corner_values:
    doc: Section 8.6.
    params:
      - id: slots
        type: u4
    seq:
      - id: entries
        type: corner_entry
        repeat: expr
        repeat-expr: slots
      - id: values
        type: corner_value
        repeat: eos
  corner_entry:
    seq:
      - id: mask
        type: b27
      - id: own_corners
        type: b1
      - id: zero
        type: b4
      - id: first
        type: u4
        doc: Words from the start of the attachment.
  corner_value:
    seq:
      - id: red
        type: u1
      - id: green
        type: u1
      - id: blue
        type: u1
      - id: alpha
        type: u1
      - id: normal
        type: u4
enums:
  codec:
    0: raw
    1: zstandard
    2: fields
  attachment:
    1: color_blocks
    2: normal_blocks
    3: constant_color
    4: ambient_blocks
    5: plain_colors
    6: plain_normals
    7: corners
    8: emission
    9: roughness_metalness
    10: opacity
    11: material
  number_format:
    1: u8
    2: unorm8
    3: u16
    4: unorm16
    5: f16
    6: u32
    7: f32
    8: rgb9e5
