"""The CRC of many rows at once against the library's, one by one."""

import numpy as np
import pytest
from fastcrc.crc16 import mcrf4xx

from gcs_health.mavlink.crc import LONGEST, WORD, crc_of_rows


@pytest.mark.parametrize("words", range(1, LONGEST // WORD + 1))
def test_crc_of_rows_is_that_of_each_rows_last_bytes(words: int) -> None:
    rng = np.random.default_rng(words)
    width = words * WORD
    length = np.minimum(rng.integers(1, width + 1, 40), LONGEST - 1)
    block = rng.integers(0, 256, (len(length), width), dtype=np.uint8)
    expected = [mcrf4xx(row[-n:].tobytes()) for row, n in zip(block, length, strict=True)]
    assert crc_of_rows(block, length).tolist() == expected
