"""The times that recordings write before a sentence and behind its checksum: read rightly, or not at all."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest

from coastwatch.formats.intake.timestamps import leading_time_s, trailing_time_s

pytestmark = pytest.mark.contract

NOON_S = datetime(2024, 5, 6, 12, tzinfo=UTC).timestamp()


@pytest.mark.parametrize(
    "text",
    [
        "2024-05-06 12:00:00 UTC ",
        "2024-05-06;12:00:00;",
        "2024-05-06\t12:00:00\t",
        "2024-05-06, 12:00:00, ",
        "2024-05-06 12:00:00 station1 ",
        "2024-05-06 12:00:00 GMT: ",
        "2024-05-06 12:00:00 -- ",
        "2024-05-06T12:00:00 -80 ",  # the strength of the signal
        "2024-05-06T12:00:00 -05 1 ",
        "2024-05-06T12:00:00,7,",
        "2024-05-06_12:00:00 ",
        "2024-05-06T14:00:00+02 ",
        "1.7149968e+09,",
        "2024-05-06 12:00:00: ",
        "2024-05-06 12:00 ",
        "2024/05/06 12:00:00,000 ",
        "[2024-05-06 12:00:00] ",
        "2024-05-06T12:00:00.0000000Z,257001,",
        "2024-05-06T14:00:00+02:00 ",
        "2024-05-06 14:00:00 +0200 ",
        "20240506T120000Z ",
        "20240506120000 ",
        "20240506,120000,",
        "1714996800 ",
        "1714996800.0,",
        "1714996800000: ",
    ],
)
def test_a_time_before_a_sentence(text: str) -> None:
    assert leading_time_s(text.encode()) == NOON_S


@pytest.mark.parametrize(
    "text", [",rRDSULI1,1714996800", ",2024-05-06T12:00:00Z", " 2024-05-06 12:00:00", ",20240506120000", " 1714996800000"]
)
def test_a_time_behind_a_sentence(text: str) -> None:
    assert trailing_time_s(text.encode()) == NOON_S


@pytest.mark.parametrize(
    "text",
    [
        *("2024-05-06", "2024-05-06 ", "2024-13-06 12:00:00", "2024-05-06 12.00.00 ", "06/05/2024 12:00:00 ", "12:00:00 "),
        *("2024-05-06 12:00:00 CEST ", "2024-05-06 01:00:00 PM "),  # which would be wrong by hours
        *("17 ", "240506 120000 ", "20241306120000 ", "station1 ", ""),
    ],
)
def test_what_is_no_time_or_may_be_another_one_is_none(text: str) -> None:
    assert np.isnan(leading_time_s(text.encode()))
    assert np.isnan(trailing_time_s(b"," + text.encode()))
