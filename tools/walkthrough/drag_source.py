"""Drop files onto a window as a file manager does: the source's side of the XDND protocol, version 5.

    python drag_source.py X Y FILE...

X and Y are pixels of the screen. Exit code 0 once the window has taken the files, 1 if it refuses them or does not
answer. See https://www.freedesktop.org/wiki/Specifications/XDND
"""

from __future__ import annotations

import ctypes
import sys
import time
from ctypes import POINTER, Structure, Union, byref, c_char_p, c_int, c_long, c_ulong, c_void_p
from ctypes.util import find_library
from pathlib import Path

VERSION, PATIENCE = 5, 10.0
"""Version of the protocol, and seconds to wait for an answer."""
_SELECTION_REQUEST, _SELECTION_NOTIFY, _CLIENT_MESSAGE = 30, 31, 33
_ATOM, _CURRENT_TIME, _REPLACE, _ANY = 4, 0, 0, 0
"""Numbers of X11's events, and of its own type, time and modes."""


class _Message(Structure):
    """An XClientMessageEvent."""

    _fields_ = (
        ("type", c_int),
        ("serial", c_ulong),
        ("sent", c_int),
        ("display", c_void_p),
        ("window", c_ulong),
        ("kind", c_ulong),
        ("format", c_int),
        ("data", c_long * 5),
    )


class _Request(Structure):
    """An XSelectionRequestEvent; the first of an XSelectionEvent are the same but for the owner."""

    _fields_ = (
        ("type", c_int),
        ("serial", c_ulong),
        ("sent", c_int),
        ("display", c_void_p),
        ("owner", c_ulong),
        ("requestor", c_ulong),
        ("selection", c_ulong),
        ("target", c_ulong),
        ("property", c_ulong),
        ("time", c_ulong),
    )


class _Notice(Structure):
    """An XSelectionEvent."""

    _fields_ = tuple(field for field in _Request._fields_ if field[0] != "owner")


class _Event(Union):
    _fields_ = (
        ("type", c_int),
        ("message", _Message),
        ("request", _Request),
        ("notice", _Notice),
        ("all", c_long * 24),
    )


class Source:
    """A window that files are dragged from."""

    def __init__(self) -> None:
        self._x = ctypes.CDLL(find_library("X11") or "libX11.so.6")
        for name in ("XOpenDisplay", "XDefaultRootWindow", "XCreateSimpleWindow", "XInternAtom"):
            getattr(self._x, name).restype = c_void_p if name == "XOpenDisplay" else c_ulong
        self._display = c_void_p(self._x.XOpenDisplay(None))
        if not self._display.value:
            raise SystemExit("there is no X server to drop files on")
        self._root = c_ulong(self._x.XDefaultRootWindow(self._display))
        size = (0, 0, 1, 1, 0, c_ulong(0), c_ulong(0))
        self._window = c_ulong(self._x.XCreateSimpleWindow(self._display, self._root, *size))

    def drop(self, paths: list[Path], x: int, y: int) -> bool:
        """Drop files at a pixel of the screen; whether they were taken."""
        uris = "".join(f"{path.resolve().as_uri()}\r\n" for path in paths).encode()
        target = self._target(self._root)
        if target is None:
            return False
        self._x.XSetSelectionOwner(self._display, self._atom("XdndSelection"), self._window, _CURRENT_TIME)
        self._tell(target, "XdndEnter", VERSION << 24, self._atom("text/uri-list").value)
        for _ in range(3):  # as while the mouse moves
            self._tell(target, "XdndPosition", 0, x << 16 | y, _CURRENT_TIME, self._atom("XdndActionCopy").value)
            answer = self._answer("XdndStatus", uris)
            if answer is None or not answer[1] & 1:
                return False
        self._tell(target, "XdndDrop", 0, _CURRENT_TIME)
        return self._answer("XdndFinished", uris) is not None

    def _atom(self, name: str) -> c_ulong:
        return c_ulong(self._x.XInternAtom(self._display, name.encode(), 0))

    def _target(self, window: c_ulong) -> c_ulong | None:
        """The first window below this one that takes drops."""
        above, root, count, windows = c_ulong(), c_ulong(), c_int(), POINTER(c_ulong)()
        self._x.XQueryTree(self._display, window, byref(root), byref(above), byref(windows), byref(count))
        below = [c_ulong(windows[i]) for i in range(count.value)]
        for child in below:
            kind, form, items, left, data = c_ulong(), c_int(), c_ulong(), c_ulong(), c_char_p()
            wanted = (self._atom("XdndAware"), c_long(0), c_long(1), 0, c_ulong(_ANY))
            found = (byref(kind), byref(form), byref(items), byref(left), byref(data))
            self._x.XGetWindowProperty(self._display, child, *wanted, *found)
            if kind.value:
                return child
        return next(filter(None, map(self._target, below)), None)

    def _tell(self, target: c_ulong, kind: str, *data: int) -> None:
        numbers = (c_long * 5)(self._window.value, *data)
        message = _Message(_CLIENT_MESSAGE, 0, 1, self._display, target, self._atom(kind), 32, numbers)
        self._send(target, _Event(message=message))

    def _send(self, target: c_ulong, event: _Event) -> None:
        self._x.XSendEvent(self._display, target, 0, c_long(0), byref(event))
        self._x.XFlush(self._display)

    def _answer(self, kind: str, uris: bytes) -> list[int] | None:
        """Wait for a message of the target, and give it the files when it asks for them; None if it stays away."""
        end, wanted, event = time.monotonic() + PATIENCE, self._atom(kind).value, _Event()
        while time.monotonic() < end:
            if not self._x.XPending(self._display):
                time.sleep(0.01)
                continue
            self._x.XNextEvent(self._display, byref(event))
            if event.type == _SELECTION_REQUEST:
                self._hand_over(event.request, uris)
            elif event.type == _CLIENT_MESSAGE and event.message.kind == wanted:
                return list(event.message.data)
        return None

    def _hand_over(self, asked: _Request, uris: bytes) -> None:
        place, kind = (c_ulong(number) for number in (asked.property, asked.target))
        asker = c_ulong(asked.requestor)
        self._x.XChangeProperty(self._display, asker, place, kind, 8, _REPLACE, uris, len(uris))
        named = (asked.requestor, asked.selection, asked.target, asked.property, asked.time)
        self._send(asker, _Event(notice=_Notice(_SELECTION_NOTIFY, 0, 1, self._display, *named)))


if __name__ == "__main__":
    sys.exit(not Source().drop([Path(name) for name in sys.argv[3:]], int(sys.argv[1]), int(sys.argv[2])))
