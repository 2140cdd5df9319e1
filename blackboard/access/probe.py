"""Why a session with a router does not open.

Zenoh says only that it could not connect, so this makes a TLS handshake by the standard library.
"""

import socket
import ssl
from dataclasses import dataclass

from blackboard.access.identity import Identity

SECONDS = 1.0  # for each step of a handshake

NO_TLS = "what listens there does not speak TLS: start `blackboard router` with --keys"

#: What the alerts of a router mean, by words in OpenSSL's name of them.
ALERTS = {
    "CERTIFICATE_EXPIRED": "the certificate has expired",
    "CERTIFICATE_REQUIRED": "the router asks for a certificate and got none",
    "UNKNOWN_CA": "the certificate was signed by another authority than the router's",
    "DECRYPT_ERROR": "the certificate was signed by another authority than the router's",
    "BAD_CERTIFICATE": "the router does not take the certificate",
    "UNSUPPORTED_CERTIFICATE": "the certificate is not made for connecting to a router",
}


@dataclass(frozen=True)
class Spelling:
    """How those who open a session give its endpoints and keys, for lines that say what to give."""

    endpoint: str  # as a line begins that gives one
    endpoints: str
    keys: str
    directory: str  # as a line begins that gives the directory of keys


FLAGS = Spelling("-e ", "-e or -l", "--keys", "--keys ")
ARGUMENTS = Spelling("endpoint=", "endpoint=", "keys=", "keys=")  # of a call in Python


def fault(endpoints: list[str], identity: Identity | None, *, last: bool, spelling: Spelling = FLAGS) -> str | None:
    """What is wrong, in a few words, at the first endpoint where waiting does not help; None where no process listens, or
    nothing is found.

    `last`: this is the last attempt, so what may only be slow is reported, too. Without an identity it is only checked whether
    the other end expects TLS where a plain session is tried.
    """
    for endpoint in endpoints:
        protocol, _, address = endpoint.partition("/")
        host, _, port = address.split("#")[0].split("?")[0].rpartition(":")
        if not port.isdigit():
            continue
        problem = None
        if protocol == "tls" and identity is not None:
            problem = _handshake(host.strip("[]"), int(port), identity, last)
        elif protocol == "tcp" and identity is None:
            problem = _plain(host.strip("[]"), int(port), spelling)
        if problem is not None:
            return f"{endpoint}: {problem}"
    return None


def _handshake(host: str, port: int, identity: Identity, last: bool) -> str | None:
    """One handshake with a certificate: what went wrong, or None."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        context.load_verify_locations(identity.ca)
        context.load_cert_chain(identity.certificate, identity.key)
    except (OSError, ssl.SSLError) as error:
        return f"the certificate, its key or the authority's certificate cannot be used ({_reason(error)})"
    connected = shaken = False
    try:
        with socket.create_connection((host, port), SECONDS) as plain:
            connected = True
            plain.settimeout(SECONDS)
            with context.wrap_socket(plain, server_hostname=host) as secure:
                shaken = True
                secure.recv(1)  # with TLS 1.3 a router refuses a certificate only after the client's side is done
    except ssl.SSLError as error:
        return _meaning(error, host)
    except OSError:  # no process listens, or it does not answer: wait and try again
        return NO_TLS if last and connected and not shaken else None
    return None


def _meaning(error: ssl.SSLError, host: str) -> str:
    """What a failed handshake means, and the cure where it is not the certificate's folder."""
    if isinstance(error, ssl.SSLCertVerificationError):
        if "match" in error.verify_message:  # "IP address mismatch", "Hostname mismatch"
            return f"the router's certificate is not for {host}: `blackboard keys renew router --name {host}`"
        return f"the router's certificate is not of this team's authority, or not valid now ({error.verify_message})"
    reason = _reason(error)
    if any(word in reason for word in ("WRONG_VERSION", "EOF", "UNEXPECTED", "RECORD_LAYER")):
        return NO_TLS
    return next((text for word, text in ALERTS.items() if word in reason), f"the TLS handshake failed ({reason})")


def _plain(host: str, port: int, spelling: Spelling) -> str | None:
    """Whether a plain session is tried with a router that has keys."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    try:
        with socket.create_connection((host, port), SECONDS) as plain:
            plain.settimeout(SECONDS)
            with context.wrap_socket(plain):
                pass
    except OSError:  # TLS errors too
        return None
    return f"the router there asks for certificates: give {spelling.keys}, and {spelling.endpoint}tls/{host}:{port}"


def _reason(error: OSError) -> str:
    return getattr(error, "reason", None) or error.strerror or str(error)
