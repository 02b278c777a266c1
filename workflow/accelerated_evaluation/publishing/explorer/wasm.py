"""Encoding of WebAssembly modules in their binary format, with the instructions that the kernels need.

The names of operations are those of the specification (WebAssembly Core 2.0, chapter 5, Binary Format).
"""

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

I32, F64, V128 = 0x7F, 0x7C, 0x7B
PAGE = 65_536  # bytes of a page of memory

OPERATIONS = {
    "unreachable": 0x00,
    "block": 0x02,
    "loop": 0x03,
    "if": 0x04,
    "else": 0x05,
    "end": 0x0B,
    "br": 0x0C,
    "br_if": 0x0D,
    "return": 0x0F,
    "call": 0x10,
    "drop": 0x1A,
    "select": 0x1B,
    "local.get": 0x20,
    "local.set": 0x21,
    "local.tee": 0x22,
    "i32.load": 0x28,
    "f64.load": 0x2B,
    "i32.store": 0x36,
    "f64.store": 0x39,
    "i32.const": 0x41,
    "f64.const": 0x44,
    "i32.eqz": 0x45,
    "i32.eq": 0x46,
    "i32.ne": 0x47,
    "i32.lt": 0x48,
    "i32.gt": 0x4A,
    "i32.le": 0x4C,
    "i32.ge": 0x4E,
    "f64.eq": 0x61,
    "f64.ne": 0x62,
    "f64.lt": 0x63,
    "f64.gt": 0x64,
    "f64.le": 0x65,
    "f64.ge": 0x66,
    "i32.add": 0x6A,
    "i32.sub": 0x6B,
    "i32.mul": 0x6C,
    "i32.rem": 0x6F,
    "i32.and": 0x71,
    "i32.or": 0x72,
    "i32.shl": 0x74,
    "f64.abs": 0x99,
    "f64.neg": 0x9A,
    "f64.floor": 0x9C,
    "f64.add": 0xA0,
    "f64.sub": 0xA1,
    "f64.mul": 0xA2,
    "f64.div": 0xA3,
    "f64.convert_i32": 0xB7,
}
# Operations on a vector of two floats or two truths. A truth has 64 bits, all of them 1 if it is true.
VECTOR_OPERATIONS = {
    "v128.load": 0,
    "v128.store": 11,
    "i32x4.splat": 17,
    "f64x2.splat": 20,
    "f64x2.eq": 71,
    "f64x2.ne": 72,
    "f64x2.lt": 73,
    "f64x2.gt": 74,
    "f64x2.le": 75,
    "f64x2.ge": 76,
    "v128.not": 77,
    "v128.and": 78,
    "v128.or": 80,
    "v128.bitselect": 82,
    "f64x2.floor": 117,
    "f64x2.abs": 236,
    "f64x2.neg": 237,
    "f64x2.add": 240,
    "f64x2.sub": 241,
    "f64x2.mul": 242,
    "f64x2.div": 243,
    "f64x2.pmin": 246,
    "f64x2.pmax": 247,
}
EMPTY = 0x40  # type of a block without a result
SELECT_VECTOR = bytes([0x1C, 1, V128])  # select, for two vectors and one truth
TRUNCATE = b"\xfc\x02"  # i32.trunc_sat_f64_s: a float to the next integer towards zero, without a trap


def unsigned(value: int) -> bytes:
    """Encode an unsigned integer in LEB128: 7 bits per byte, the lowest first."""
    encoded = bytearray()
    while True:
        value, low = value >> 7, value & 0x7F
        if not value:
            return bytes([*encoded, low])
        encoded.append(low | 0x80)


def signed(value: int) -> bytes:
    """Encode a signed integer in LEB128: 7 bits per byte of its two's complement, the lowest first."""
    encoded = bytearray()
    while True:
        value, low = value >> 7, value & 0x7F
        if value == -(low >> 6):  # all further bits equal the sign bit
            return bytes([*encoded, low])
        encoded.append(low | 0x80)


def vector(parts: Iterable[bytes]) -> bytes:
    """Encode a list: the number of its parts, followed by the parts, which are encoded already."""
    listed = list(parts)
    return unsigned(len(listed)) + b"".join(listed)


def instruction(name: str, *operands: int | float) -> bytes:
    """Encode one instruction with its operands.

    Parameters
    ----------
    name
        Name in `OPERATIONS` or `VECTOR_OPERATIONS`.
    operands
        The constant; the index of a variable or function; the offset in bytes for load and store; or the type
        of a block with a result.
    """
    if name in VECTOR_OPERATIONS:
        code = b"\xfd" + unsigned(VECTOR_OPERATIONS[name])
    else:
        code = bytes([OPERATIONS[name]])
    if name == "f64.const":
        return code + struct.pack("<d", operands[0])
    if name == "i32.const":
        return code + signed(int(operands[0]))
    if name.endswith(("load", "store")):  # the first operand is the alignment, as a power of two
        alignment = 2 if name.startswith("i32") else 3
        return code + unsigned(alignment) + unsigned(int(operands[0]))
    if name in ("block", "loop", "if"):
        return code + bytes([int(operands[0]) if operands else EMPTY])
    return code + b"".join(unsigned(int(operand)) for operand in operands)


@dataclass
class Function:
    """A function of a module of WebAssembly.

    Attributes
    ----------
    parameters, results
        Value types, `I32`, `F64` or `V128`.
    local_types
        Types of the parameters, followed by those of the local variables.
    code
        Instructions, without the final ``end``.
    """

    parameters: Sequence[int]
    results: Sequence[int] = ()
    local_types: list[int] = field(default_factory=list)
    code: bytearray = field(default_factory=bytearray)

    @property
    def type(self) -> bytes:
        """Signature of the function: types of parameters and results in the binary format."""
        return (
            b"\x60"
            + vector(bytes([kind]) for kind in self.parameters)
            + vector(bytes([kind]) for kind in self.results)
        )

    @property
    def body(self) -> bytes:
        """Local variables and instructions of the function in the binary format."""
        own = self.local_types[len(self.parameters) :]
        content = vector(unsigned(1) + bytes([kind]) for kind in own) + bytes(self.code) + b"\x0b"
        return unsigned(len(content)) + content


def module(functions: Sequence[Function], exports: dict[str, int], memory: int) -> bytes:
    """Return a module of WebAssembly in its binary format.

    Parameters
    ----------
    functions
        All functions.
    exports
        Index of each exported function, by its name. The memory is exported as ``memory``.
    memory
        Size of the memory in bytes; it is rounded up to whole pages.
    """
    named = [_name(name) + b"\x00" + unsigned(index) for name, index in exports.items()]
    sections = {
        1: vector(function.type for function in functions),
        3: vector(unsigned(index) for index in range(len(functions))),
        5: vector([b"\x00" + unsigned(-(-memory // PAGE))]),
        7: vector([_name("memory") + b"\x02\x00", *named]),
        10: vector(function.body for function in functions),
    }
    parts = (bytes([number]) + unsigned(len(content)) + content for number, content in sections.items())
    return b"\x00asm\x01\x00\x00\x00" + b"".join(parts)


def _name(text: str) -> bytes:
    encoded = text.encode()
    return unsigned(len(encoded)) + encoded
