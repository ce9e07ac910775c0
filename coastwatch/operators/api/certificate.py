"""The TLS certificate of a server: read again when its files change; new connections have the new one. It says when it ends."""

from __future__ import annotations

import ssl
import time
from datetime import UTC, datetime
from pathlib import Path

from cryptography import x509

from coastwatch.errors import InputError
from coastwatch.operators.api.people import stamp
from coastwatch.server.troubles import Trouble

SOON_S = 14 * 86_400.0
"""So long before the end it is a trouble. Programs that renew do so a month before."""


class Certificate:
    """A certificate chain and its key. While the files cannot be read, or do not fit together, those of before hold."""

    def __init__(self, chain: Path, key: Path) -> None:
        """Raises: InputError that names the files."""
        self._chain, self._key = chain, key
        self._wrong: tuple[float, str] | None = None  # since when, and what
        try:
            self._read_at = self._stamps()
            self._now, self.ends_s = self._read(None)
        except (OSError, ValueError) as error:
            raise InputError(
                f"--tls-cert, --tls-key: got {chain} and {key}: {_reason(error)}, needed a certificate and its key"
            ) from None
        # Each connection that begins asks for the newest one; a context that is in use is never changed.
        self.context = self._now
        self.context.sni_callback = self._choose

    @property
    def left_s(self) -> float:
        """Until the certificate ends; negative: it has."""
        return self.ends_s - time.time()

    def reread(self) -> None:
        """Read the files again, whether they have changed or not."""
        self._read_at = None
        self._reload()

    def troubles(self) -> list[Trouble]:
        """What is wrong with the files now, and whether the certificate ends soon."""
        self._reload()
        wrong = [] if self._wrong is None else [Trouble("certificate", self._chain.name, *self._wrong, False)]
        if (left_s := self.left_s) < SOON_S:
            day = datetime.fromtimestamp(self.ends_s, UTC).date().isoformat()
            text = f"the certificate ends on {day}" if left_s > 0.0 else f"the certificate ended on {day}"
            wrong.append(Trouble("certificate", "", None, text, False))
        return wrong

    def _choose(self, connection: ssl.SSLObject | ssl.SSLSocket, name: str | None, context: ssl.SSLContext) -> None:
        connection.context = self._now

    def _reload(self) -> None:
        try:
            stamps = self._stamps()
            if stamps == self._read_at:
                return
            self._now, self.ends_s = self._read("")
        except (OSError, ValueError) as error:
            stamps = None  # a key that is written after its certificate: the next look may find both
            since_s = time.time() if self._wrong is None else self._wrong[0]
            self._wrong = since_s, f"the certificate of before holds: {_reason(error)}"
        else:
            self._wrong = None
        self._read_at = stamps

    def _read(self, password: str | None) -> tuple[ssl.SSLContext, float]:
        """A context with the files, and when the certificate ends. Args: password: of the key; None: OpenSSL asks on the terminal.

        Raises: OSError, ValueError.
        """
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(self._chain, self._key, password)
        return context, ends_s(self._chain.read_bytes())

    def _stamps(self) -> tuple[object, object] | None:
        return stamp(self._chain), stamp(self._key)


def ends_s(chain: bytes) -> float:
    """When the first certificate of a PEM text ends, Unix time. Raises: ValueError."""
    return x509.load_pem_x509_certificates(chain)[0].not_valid_after_utc.timestamp()


def _reason(error: Exception) -> str:
    if isinstance(error, ssl.SSLError) and error.reason:
        return error.reason.lower().replace("_", " ")
    return error.strerror if isinstance(error, OSError) and error.strerror else str(error)
