"""Ways in which bytes from strangers are wrong, for hypothesis to choose from."""

import gzip
import json
import os
import re
from collections.abc import Callable
from typing import Any

from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st

#: Without the setting always the same few, since a file of a model may crash MuJoCo itself.
FILES = int(os.environ.get("REHYB_FUZZ", "40"))
FUZZ = settings(
    max_examples=FILES,
    deadline=None,
    database=None,
    derandomize="REHYB_FUZZ" not in os.environ,
    phases=[Phase.generate],
    suppress_health_check=list(HealthCheck),
)
#: What JSON and CSV hold in a place where something else belongs; not all of it is JSON.
WORDS = (
    *(b"null", b"true", b"-1", b"0", b"1e400", b"-0.0", b"NaN", b"Infinity", b"1e308", b"5e-324"),
    *(b"9223372036854775808", b"1" * 400, b'""', b'"\\u0000"', b'"\\ud800"', b'"\xc3\x28"'),
    *(b"[]", b"{}", b"[[1]]", b'{"a": 1, "a": 2}', b"[" * 3000, b'{"a":' * 3000, b'"' + b"x" * 300),
    *(b"../../etc/passwd", b"\x00", b"\xff\xfe", b"\xef\xbb\xbf", b"\r\n", b"\x1b[2J", b"&#x0;"),
)
_PLACE = st.floats(0.0, 1.0)
#: How, where (0 to 1), how many bytes, and what is put in.
Edit = tuple[str, float, int, bytes]
_EDIT = st.tuples(
    st.sampled_from(["cut", "drop", "twice", "put", "flip"]),
    _PLACE,
    st.integers(1, 40),
    st.sampled_from(WORDS),
)
EDITS = st.lists(_EDIT, min_size=1, max_size=4)
#: Mostly none: most bytes that are changed make no JSON and no XML.
SOME_EDITS = st.one_of(st.just([]), st.just([]), EDITS)
#: As a value is replaced: which, by what; "" drops it.
SWAPS = st.lists(st.tuples(st.integers(0, 60), st.sampled_from((b"", *WORDS))), max_size=3)


def edited(content: bytes, edits: list[Edit]) -> bytes:
    """Return content after edits."""
    for how, where, size, word in edits:
        at = int(where * len(content))
        before, here, after = content[:at], content[at : at + size], content[at + size :]
        content = {
            "cut": before,
            "drop": before + after,
            "twice": before + here + here + after,
            "put": before + word + here + after,
            "flip": before + bytes(one ^ (1 << size % 8) for one in here[:1]) + here[1:] + after,
        }[how]
    return content


def swapped(content: Any, swaps: list[tuple[int, bytes]]) -> bytes:
    """Return JSON in which some values are replaced by words that may be no JSON."""
    count = -1
    replaced: dict[str, bytes] = {}

    def walk(value: Any) -> Any:
        nonlocal count
        count += 1
        for number, word in swaps:
            if number == count and count > 0:
                mark = f"\N{LOZENGE}{count}\N{LOZENGE}"
                replaced[json.dumps(mark)] = word or b"null"
                return mark
        if isinstance(value, dict):
            return {name: walk(one) for name, one in value.items()}
        return [walk(one) for one in value] if isinstance(value, list) else value

    text = json.dumps(walk(content)).encode()
    for mark, word in replaced.items():
        text = text.replace(mark.encode(), word)
    return text


#: Numbers, and lists of them, that an attribute of XML may hold beside `WORDS`.
NUMBERS = (
    *(b"", b"1", b"-1 0 0", b"0 0 0 0", b"1e-320", b"1e30", b"-1e308 1e308", b"1e99 1 1"),
    *(b"2147483648", b"nan", b"inf 0 0", b"0x1p3", b"1,0", b"hinge", b"forearm", b"auto"),
)
XmlSwap = tuple[str, int, bytes]
#: What is done to XML: to which attribute or element, and what the attribute says then.
_XML_SWAP = st.tuples(
    st.sampled_from(["say", "unsay", "drop", "twice", "inside"]),
    st.integers(0, 60),
    st.sampled_from((*NUMBERS, *(word for word in WORDS if not {*word} & {*b'"<&'}))),
)
XML_SWAPS = st.lists(_XML_SWAP, max_size=3)
_ATTRIBUTE, _ELEMENT = re.compile(rb' [a-z]+="([^"]*)"'), re.compile(rb"<[^<>?]+/>")


def swapped_xml(content: bytes, swaps: list[XmlSwap]) -> bytes:
    """Return XML whose attributes say something else, and whose empty elements are elsewhere."""
    for how, number, word in swaps:
        found = [*(_ATTRIBUTE if how in ("say", "unsay") else _ELEMENT).finditer(content)]
        if not found:
            continue
        place = found[number % len(found)]
        start, stop = place.span(1) if how == "say" else place.span()
        here = content[start:stop]
        # Into the next tag that is open, wherever that is.
        inside = content.find(b">", stop) + 1 or stop
        content = {
            "say": content[:start] + word + content[stop:],
            "unsay": content[:start] + content[stop:],
            "drop": content[:start] + content[stop:],
            "twice": content[:stop] + here + content[stop:],
            "inside": content[:start] + content[stop:inside] + here + content[inside:],
        }[how]
    return content


#: How a body is wrapped: its `Content-Encoding`, and what is made of it.
WRAPPINGS: dict[str, tuple[str, Callable[[bytes], bytes]]] = {
    "plain": ("", bytes),
    "gzip": ("gzip", gzip.compress),
    "gzip without its end": ("gzip", lambda body: gzip.compress(body)[:-5]),
    "gzip and more": ("gzip", lambda body: gzip.compress(body) + b"more"),
    "gzip twice": ("gzip", lambda body: gzip.compress(gzip.compress(body))),
    "two gzip files": ("gzip", lambda body: gzip.compress(body) + gzip.compress(body)),
    "gzip of a sea of zeros": ("gzip", lambda body: gzip.compress(body + bytes(9_000_000))),
    "gzip that is none": ("gzip", bytes),
    "another encoding": ("br", bytes),
    "a list of encodings": ("gzip, gzip", gzip.compress),
}

HEADERS: tuple[dict[str, str], ...] = (
    {},
    {"content-type": "text/plain"},
    {"content-type": "application/json; charset=utf-16"},
    {"content-type": "multipart/form-data"},
    {"content-type": "multipart/form-data; boundary="},
    {"content-type": "multipart/form-data; boundary=" + "b" * 300},
    {"content-type": ";;;="},
    {"idempotency-key": "x" * 300},
    {"idempotency-key": "\xff\x7f"},
    {"if-none-match": '"' * 200},
    {"if-none-match": 'W/"\xff", *, ,,'},
    {"accept": "text/html;q=NaN"},
    {"content-length": "-1"},
    {"content-length": "99999999999999999999"},
    {"expect": "100-continue"},
    {"range": "bytes=0-0,1-9999999999999"},
    {"cookie": "rehyb=\xff; =; ;;"},
    {"x-rehyb-worker": "\xff" * 200},
    {"last-event-id": "\xff"},
)


def encrypted(content: bytes) -> bytes:
    """Return a zip file whose first member is said to need a password."""
    changed = bytearray(content)
    for mark, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        changed[changed.index(mark) + offset] |= 1
    return bytes(changed)
