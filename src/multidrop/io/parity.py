"""The marks that a POSIX port puts before a byte with a parity or framing error (PARMRK)."""

from __future__ import annotations


class ParityMarks:
    """Splits what a marking port delivers: FFh 00h x is the wrong byte x, FFh FFh a good FFh."""

    def __init__(self) -> None:
        self._open = b""  # the beginning of a mark whose end has not come yet

    def split(self, data: bytes) -> list[tuple[bytes, bool]]:
        """Pieces of the stream in order, each with whether it is wrong."""
        data = self._open + data
        pieces: list[tuple[bytes, bool]] = []
        good = bytearray()
        at = 0
        while at < len(data):
            mark = data.find(0xFF, at)
            if mark < 0:
                good += data[at:]
                at = len(data)
                break
            good += data[at:mark]
            at = mark
            following = data[mark + 1 : mark + 3]
            if following[:1] == b"\xff":
                good.append(0xFF)
                at += 2
            elif len(following) == 2 and following[0] == 0:
                if good:
                    pieces.append((bytes(good), False))
                    good.clear()
                pieces.append((following[1:], True))
                at += 3
            elif len(following) < 2 and following in (b"", b"\0"):
                break
            else:  # no port that marks sends this: take the FFh as it stands
                good.append(0xFF)
                at += 1
        self._open = data[at:]
        if good:
            pieces.append((bytes(good), False))
        return pieces
