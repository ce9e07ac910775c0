"""The sentences of a feed that are wanted, cut from its lines as they come, and what pynmeagps makes of one."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

from pynmeagps import NMEAParseError, NMEAReader

from coastwatch.formats.decoding import Item
from coastwatch.formats.intake.faults import Ledger, Tally
from coastwatch.formats.intake.timestamps import checksum
from coastwatch.formats.nmea.messages import UNDECODABLE
from coastwatch.formats.nmea.sentences import CHECKSUM, LinesBefore, wanted_sentences


class FedSentence(NamedTuple):
    """A sentence of a feed."""

    sentence: bytes
    time_s: float  # of its own, else of the last clock sentence, else of arrival; NaN: none
    arrived_s: float  # NaN: not known
    where: str  # of the sentence, for the tally


class SentenceFeed:
    """The lines of one feed, as they come, to sentences with these formatters."""

    def __init__(self, name: str, wanted: tuple[bytes, ...], tally: Tally, ledger: Ledger) -> None:
        """Args: name: of the feed; tally, ledger: of it."""
        self._name, self._wanted, self._tally, self._ledger = name, wanted, tally, ledger
        self._seen = 0  # lines that have come
        self._before = LinesBefore()

    def sentences(self, items: list[Item]) -> Iterator[FedSentence]:
        """The wanted sentences of lines that have come, in order. Other lines are counted."""
        first = self._seen
        self._seen += len(items)
        lines = [line for _, line, _ in items]
        for received in wanted_sentences(lines, self._name, self._tally, self._wanted, self._ledger, self._before):
            arrived_s = items[received.line - 1][0]
            stamps = (s for s in (received.own_s, received.clock_s, arrived_s) if not math.isnan(s))
            where = f"{self._name}:{first + received.line}"
            yield FedSentence(received.sentence, next(stamps, math.nan), arrived_s, where)


def parsed_sentence(sentence: bytes, where: str, tally: Tally) -> Any:
    """The message of a sentence, with the fields of pynmeagps; None: it has none, and is counted. Args: where: for the tally."""
    message: Any = None
    fault = UNDECODABLE
    try:
        message = NMEAReader.parse(sentence)
    except NMEAParseError as error:
        fault = CHECKSUM if "checksum" in str(error) else UNDECODABLE
    except Exception:  # a sentence that pynmeagps cannot parse must not stop the feed
        message = None
    if message is None:
        tally.add(fault, where, sentence)
    return message


def has_numbers(message: Any, *names: str) -> bool:
    """Whether fields of a message are there and finite numbers."""
    values = (getattr(message, name, None) for name in names)
    return all(isinstance(value, int | float) and math.isfinite(value) for value in values)


def made_sentence(body: str, start: str = "$") -> str:
    """A sentence, or a tag block, with its checksum. Args: body: what the checksum is of; start: what stands before it."""
    return f"{start}{body}*{checksum(body.encode()):02X}"
