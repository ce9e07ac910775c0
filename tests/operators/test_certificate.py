"""The certificate of a server is renewed while it serves; SIGHUP ends no server."""

from __future__ import annotations

import re
import signal
import socket
import ssl
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import store_world as world
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import NameOID
from server_world import wait_for

from coastwatch import store as kept
from coastwatch.errors import InputError
from coastwatch.operators.api import certificate as certificates, people
from coastwatch.operators.api.certificate import SOON_S, Certificate, ends_s

pytestmark = pytest.mark.whole

DAY_S = 86_400.0


def make(folder: Path, name: str, days: int, key: str = "ec") -> tuple[Path, Path]:
    """A certificate and its key, for so many days."""
    chain, private = folder / "cert.pem", folder / "key.pem"
    made: Any = ec.generate_private_key(ec.SECP256R1()) if key == "ec" else rsa.generate_private_key(65537, 2048)
    of, now = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)]), datetime.now(UTC)
    builder = x509.CertificateBuilder(of, of, made.public_key(), x509.random_serial_number(), now, now + timedelta(days))
    private.write_bytes(made.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    chain.write_bytes(builder.sign(made, hashes.SHA256()).public_bytes(Encoding.PEM))
    return chain, private


@contextmanager
def served(folder: Path, *more: str) -> Iterator[tuple[subprocess.Popen[str], int, list[str]]]:
    """A server of a small database in a process of its own, its port, and the lines that it prints."""
    path = folder / "watch.db"
    with kept.open_store(str(path)) as store:
        world.write(store, world.begin(store), 0)
    begin = "import sys; from coastwatch.operators.cli import main; raise SystemExit(main(sys.argv[1:]))"
    words = [sys.executable, "-c", begin, "serve", "--db", str(path), "--port", "0", *more]
    process, lines = subprocess.Popen(words, stderr=subprocess.PIPE, text=True), list[str]()
    said = process.stderr
    assert said is not None
    threading.Thread(target=lambda: lines.extend(iter(said.readline, "")), daemon=True).start()
    try:
        wait_for(lambda: re.search(r"https?://127.0.0.1:(\d+)", " ".join(lines)) or process.poll() is not None)
        (port,) = re.findall(r"https?://127.0.0.1:(\d+)", " ".join(lines))
        yield process, int(port), lines
    finally:
        process.terminate()
        process.wait(30)


def _answers(port: int) -> bool:
    with socket.socket() as asked:
        return asked.connect_ex(("127.0.0.1", port)) == 0


def name_of(port: int, server_name: str | None) -> bytes:
    """The certificate that a new connection gets, DER. Args: server_name: as of SNI."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    with (
        socket.create_connection(("127.0.0.1", port), 20.0) as plain,
        context.wrap_socket(plain, server_hostname=server_name) as secure,
    ):
        return secure.getpeercert(binary_form=True) or b""


def test_a_renewed_certificate_is_that_of_new_connections(tmp_path: Path) -> None:
    """At first by its files alone, then when a signal asks."""
    chain, key = make(tmp_path, "one", 90)
    with served(tmp_path, "--tls-cert", str(chain), "--tls-key", str(key)) as (process, port, lines):
        first = name_of(port, "watch.example")
        assert b"one" in first
        make(tmp_path, "two", 90, "rsa")
        wait_for(lambda: name_of(port, None) != first)
        second = name_of(port, "watch.example")
        assert b"two" in second
        make(tmp_path, "three", 90)
        process.send_signal(signal.SIGHUP)
        wait_for(lambda: "SIGHUP: certificate and tokens are read again" in " ".join(lines))
        wait_for(lambda: name_of(port, None) != second)
        assert b"three" in name_of(port, "watch.example")
        assert process.poll() is None


def test_files_are_read_again_when_asked_although_their_stamps_are_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (certificates, people):
        monkeypatch.setattr(module, "stamp", lambda path: (1, 2))
    certificate = Certificate(*make(tmp_path, "one", 90))
    words = [people.add(tmp_path / "tokens.toml", "ana", "viewer", None)]
    tokens = people.Tokens(tmp_path / "tokens.toml")
    ends = certificate.ends_s
    make(tmp_path, "two", 30)
    (tmp_path / "tokens.toml").unlink()
    words.append(people.add(tmp_path / "tokens.toml", "cy", "viewer", None))
    assert (certificate.troubles(), certificate.ends_s) == ([], ends)
    assert [tokens.person(word) is not None for word in words] == [True, False]
    for one in (certificate, tokens):
        one.reread()
    assert certificate.ends_s < ends
    assert [tokens.person(word) is not None for word in words] == [False, True]


def test_a_server_without_files_to_read_goes_on_after_a_hangup(tmp_path: Path) -> None:
    with served(tmp_path) as (process, port, lines):
        process.send_signal(signal.SIGHUP)
        wait_for(lambda: "SIGHUP: there is no file to read again" in " ".join(lines))
        assert process.poll() is None
        assert _answers(port)


def test_what_cannot_be_read_keeps_the_certificate_of_before_and_is_a_trouble(tmp_path: Path) -> None:
    chain, key = make(tmp_path, "one", 90)
    certificate = Certificate(chain, key)
    assert certificate.troubles() == []
    good, ends = key.read_text("ascii"), certificate.ends_s
    make(tmp_path, "two", 30)
    renewed = key.read_text("ascii")
    key.write_text(good, "ascii")  # the new chain with the old key
    (trouble,) = certificate.troubles()
    assert (trouble.kind, trouble.name, trouble.is_serious) == ("certificate", "cert.pem", False)
    assert trouble.text.startswith("the certificate of before holds: ")
    assert certificate.ends_s == ends
    key.unlink()
    assert "No such file" in certificate.troubles()[0].text
    key.write_text(renewed, "ascii")
    assert certificate.troubles() == []
    assert certificate.ends_s < ends


@pytest.mark.parametrize(("days", "said"), [(90, ""), (15, ""), (13, "the certificate ends on 20"), (30_000, "")])
def test_a_certificate_that_ends_soon_is_a_trouble(tmp_path: Path, days: int, said: str) -> None:
    certificate = Certificate(*make(tmp_path, "one", days))
    assert abs(certificate.left_s - days * DAY_S) < 600.0
    assert (certificate.left_s < SOON_S) is bool(said)
    assert [trouble.text[: len(said)] for trouble in certificate.troubles()] == ([said] if said else [])


def test_a_certificate_that_has_ended_says_so(tmp_path: Path) -> None:
    certificate = Certificate(*make(tmp_path, "one", 1))
    certificate.ends_s = time.time() - DAY_S
    assert [trouble.text[:20] for trouble in certificate.troubles()] == ["the certificate ende"]


def test_wrong_files_are_refused_before_anything_starts(tmp_path: Path) -> None:
    chain, key = make(tmp_path, "one", 90)
    for wrong in ((key, chain), (chain, tmp_path / "none.pem")):
        with pytest.raises(InputError, match=r"--tls-cert, --tls-key: got .*, needed a certificate and its key"):
            Certificate(*wrong)
    for text in (b"", b"-----BEGIN CERTIFICATE-----\nMAA=\n-----END CERTIFICATE-----"):
        with pytest.raises(ValueError, match=r"PEM|pars"):
            ends_s(text)
