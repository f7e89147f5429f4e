"""
Reads and writes only the numbers of messages, directly in the bytes that the middleware carries.

The names, frame and lengths of a topic's messages do not change. Making Python objects of them for
every message takes longer than the computation with the numbers. So the places of the numbers are
learnt from one message (plain CDR: DDS-XTypes 1.3, 7.4.1), and in messages that differ only in
their numbers nothing else is touched.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from importlib import import_module
from struct import calcsize, Struct
import sys
from types import SimpleNamespace
from typing import Any, NamedTuple

from msg_config.errors import InputError
from rclpy.serialization import deserialize_message, serialize_message
from rosidl_parser.definition import (
    AbstractNestedType,
    AbstractString,
    BasicType,
    NamespacedType,
)

# Header of plain CDR in this machine's byte order, and its size; other encodings are not learnt.
PLAIN, HEAD = (b'\0\1' if sys.byteorder == 'little' else b'\0\0'), 4
CODES = {'double': 'd', 'int32': 'i', 'uint32': 'I'}
LENGTH = Struct('=I')
# Largest message that is learnt, bytes: the names of any arm fit in.
MAX_LEARNT = 4096


class Number(NamedTuple):
    """A number or a sequence of numbers in a message: its field, format and first byte."""

    field: str
    form: str
    start: int

    @property
    def end(self) -> int:
        """Return the byte after the last."""
        return self.start + calcsize(self.form)


class Layout:
    """
    The places of the numbers in a message.

    Numbers in a sequence of messages count as constant, like names and lengths.

    Parameters
    ----------
    kind : type
        Class of the message, of doubles, (u)int32, strings, messages and sequences.
    data : bytes
        A message that rclpy can read.

    Attributes
    ----------
    numbers : list of Number
        The numbers in the order of the message.
    mask : bytes
        Ones at bytes that are constant; zeros at numbers and at padding.

    """

    def __init__(self, kind: Any, data: bytes):
        self.numbers: list[Number] = []
        self._data, self._at = data, HEAD
        self._mask = bytearray(len(data))
        self._mask[:HEAD] = bytes([255] * HEAD)
        self._message(kind, '', True)
        self.mask = bytes(self._mask)

    def _message(self, kind: Any, field: str, free: bool) -> None:
        for name, slot in zip(kind.get_fields_and_field_types(), kind.SLOT_TYPES):
            self._value(slot, f'{field}.{name}' if field else name, free)

    def _value(self, slot: Any, field: str, free: bool) -> None:
        if isinstance(slot, NamespacedType):
            module = import_module('.'.join(slot.namespaces))
            self._message(getattr(module, slot.name), field, free)
        elif isinstance(slot, BasicType):
            self._number(CODES[slot.typename], 1, field, free)
        elif isinstance(slot, AbstractString):
            self._mark_constant(self._length())
        else:
            assert isinstance(slot, AbstractNestedType), slot
            self._sequence(slot.value_type, field, free)

    def _sequence(self, slot: Any, field: str, free: bool) -> None:
        length = self._length()
        if isinstance(slot, BasicType):
            if length:
                self._number(CODES[slot.typename], length, field, free)
            return
        for _ in range(length):
            self._value(slot, field, False)

    def _number(self, code: str, count: int, field: str, free: bool) -> None:
        size = calcsize(code)
        self._at += (HEAD - self._at) % size
        if not free:
            self._mark_constant(size * count)
            return
        self.numbers.append(Number(field, f'={count}{code}', self._at))
        self._at += size * count

    def _length(self) -> int:
        self._at += (HEAD - self._at) % LENGTH.size
        length: int = LENGTH.unpack_from(self._data, self._at)[0]
        self._mark_constant(LENGTH.size)
        return length

    def _mark_constant(self, count: int) -> None:
        self._mask[self._at:self._at + count] = bytes([255] * count)
        self._at += count


class MessageReader:
    """
    Reads the messages of a topic.

    If a message differs from the last one only in its numbers, only these are read; any other is
    read by rclpy, and learnt. The result has the message's fields, but not the checks of its
    class, which are calls of Python. Do not keep a message beyond the next: it is the same object.

    Parameters
    ----------
    kind : type
        Class of the messages.
    topic : str
        Name of the topic, for error messages.

    """

    def __init__(self, kind: Any, topic: str):
        self._kind, self._topic = kind, topic
        self._size = self._mask = self._kept = -1

    def __call__(self, data: bytes) -> Any:
        """
        Return the message.

        Raises
        ------
        InputError
            The bytes are no message of this class.

        """
        if len(data) != self._size or \
                int.from_bytes(data, sys.byteorder) & self._mask != self._kept:
            return self._learnt(data)
        for (owner, name), number in zip(self._single, self._unpack(data)):
            setattr(owner, name, number)
        for owner, name, start, end in self._sequences:
            setattr(owner, name, array('d', data[start:end]))
        return self._message

    def _learnt(self, data: bytes) -> Any:
        try:
            message = _plain(deserialize_message(data, self._kind))
        except Exception as error:  # noqa: B902  rclpy's own class of it is not exported
            raise InputError(f'{self._topic}: expected a {self._kind.__name__}, got '
                             f'{len(data)} bytes that are none ({type(error).__name__})') from None
        self._size = -1
        if data[:2] == PLAIN and len(data) <= MAX_LEARNT:
            self._learn(data, message)
        return message

    def _learn(self, data: bytes, message: Any) -> None:
        layout = Layout(self._kind, data)
        single = [number for number in layout.numbers if _is_one(message, number)]
        self._message, self._size = message, len(data)
        self._mask = int.from_bytes(layout.mask, sys.byteorder)
        self._kept = int.from_bytes(data, sys.byteorder) & self._mask
        self._single = [_owner(message, number.field) for number in single]
        self._unpack = Struct(_with_gaps(single, len(data))).unpack
        self._sequences = [(*_owner(message, number.field), number.start, number.end)
                           for number in layout.numbers if number not in single]


def _plain(message: Any) -> Any:
    """Return a message's fields as plain attributes."""
    fields = {}
    for name, slot in zip(message.get_fields_and_field_types(), message.SLOT_TYPES):
        value = getattr(message, name)
        fields[name] = _plain(value) if isinstance(slot, NamespacedType) else value
    return SimpleNamespace(**fields)


def _owner(message: Any, field: str) -> tuple[Any, str]:
    """Return the (nested) message that holds a field, and the field's name in it."""
    *outer, name = field.split('.')
    for part in outer:
        message = getattr(message, part)
    return message, name


def _is_one(message: Any, number: Number) -> bool:
    return not isinstance(getattr(*_owner(message, number.field)), array)


def _with_gaps(numbers: Sequence[Number], size: int) -> str:
    """Return the format of numbers with gaps between them."""
    form, at = '=', 0
    for number in numbers:
        form += f'{number.start - at}x{number.form[1:]}'
        at = number.end
    return f'{form}{size - at}x'


class MessageWriter:
    """
    Writes messages that differ only in some of their numbers.

    Parameters
    ----------
    message : message
        One of the messages.
    fields : str
        Fields whose numbers change, for example 'header' and 'position'.

    """

    def __init__(self, message: Any, *fields: str):
        self._data = bytearray(serialize_message(message))
        layout = Layout(type(message), bytes(self._data))
        self._parts: list[tuple[Any, int, slice]] = []
        place = 0
        for number in layout.numbers:
            if number.field.startswith(fields):
                packing = Struct(number.form)
                count = len(packing.unpack_from(self._data, number.start))
                self._parts.append((packing.pack_into, number.start, slice(place, place + count)))
                place += count

    def __call__(self, *numbers: float) -> bytes:
        """Return the message with the numbers of the fields, in the message's order."""
        for pack, start, those in self._parts:
            pack(self._data, start, *numbers[those])
        return bytes(self._data)
