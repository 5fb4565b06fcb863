"""MAVLink 2 signatures: is a signed frame from who holds the key, and is it new.

Source: MAVLink developer guide, message signing: first 6 bytes of SHA-256(key, header, payload, CRC,
link id, time stamp); the stamp counts 10 µs since 2015-01-01 and must rise per (system, component, link).
"""

import hashlib
import hmac

_TAIL = 13  # link id 1, stamp 6, signature 6


class Signatures:
    """Verifies signed frames against a set of 32-byte keys and remembers each stream's last stamp."""

    def __init__(self, keys: tuple[bytes, ...]) -> None:
        self._keys = keys
        self._last: dict[tuple[int, int, int], int] = {}

    def verify(self, frame: bytes) -> str | None:
        """Return what is wrong with a signed v2 frame, "bad_signature" or "replayed"; None if all is well."""
        said, signature = frame[:-6], frame[-6:]
        for key in self._keys:
            if hmac.compare_digest(hashlib.sha256(key + said).digest()[:6], signature):
                break
        else:
            return "bad_signature"
        stream = (frame[5], frame[6], frame[-_TAIL])
        stamp = int.from_bytes(frame[-12:-6], "little")
        if stamp <= self._last.get(stream, -1):
            return "replayed"
        self._last[stream] = stamp
        return None
