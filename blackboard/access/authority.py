"""Certificates: a team's authority and what it signs, on elliptic curves (P-256).

The only file that names `cryptography` (extra `keys`).
"""

import ipaddress
from dataclasses import dataclass

from blackboard.access.members import CertificateHolder
from blackboard.errors import UserError, extra
from blackboard.process.clock import utc

with extra("keys", "what makes keys and certificates"):
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

DAY = 86400.0  # seconds
AUTHORITY_DAYS = 3650.0
EARLIER = 3600.0  # seconds by which a certificate begins earlier, for hosts whose clocks are behind


@dataclass(frozen=True)
class Pair:
    """A certificate and its private key, as PEM."""

    certificate: bytes
    key: bytes


def new_authority(team: str, now: float) -> Pair:
    """An authority of its own for a team. Its name ends with a number, so that no two authorities are taken for each other."""
    key = ec.generate_private_key(ec.SECP256R1())
    number = x509.random_serial_number()
    name = _name(team, f"authority {number:x}"[:26])
    certificate = (
        _builder(name, name, key.public_key(), number, now, now + AUTHORITY_DAYS * DAY)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(signs=True), critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .sign(key, hashes.SHA256())
    )
    return Pair(certificate.public_bytes(serialization.Encoding.PEM), _pem(key))


def issue(
    authority: Pair, member: CertificateHolder, hosts: tuple[str, ...], now: float, days: float
) -> tuple[Pair, float]:
    """A certificate for a member, and the Unix time when it ends, never after the authority's own end.

    A router's is for servers alone, under the names `hosts` (DNS names and addresses); everybody else's is for clients alone.
    UserError: the authority's files are not a certificate and its key, or its time is over.
    """
    try:
        signer = x509.load_pem_x509_certificate(authority.certificate)
        signing = serialization.load_pem_private_key(authority.key, password=None)
    except (ValueError, TypeError) as error:
        raise UserError(f"the authority's certificate or key cannot be read ({error}); restore them") from error
    if not isinstance(signing, ec.EllipticCurvePrivateKey) or signing.public_key() != signer.public_key():
        raise UserError("the authority's key does not belong to its certificate; restore them")
    last = signer.not_valid_after_utc.timestamp()
    if last <= now:
        raise UserError(
            f"the authority expired on {utc(last):%Y-%m-%d}: `blackboard keys init --force` makes a new one"
        )
    ends, key = min(now + days * DAY, last), ec.generate_private_key(ec.SECP256R1())
    server = member.kind == "router"
    purpose = ExtendedKeyUsageOID.SERVER_AUTH if server else ExtendedKeyUsageOID.CLIENT_AUTH
    name = _name(member.team, member.common_name)
    builder = (
        _builder(name, signer.subject, key.public_key(), x509.random_serial_number(), now, ends)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage([purpose]), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(signing.public_key()), critical=False)
    )
    if server:
        builder = builder.add_extension(x509.SubjectAlternativeName(_names(hosts)), critical=False)
    certificate = builder.sign(signing, hashes.SHA256())
    return Pair(certificate.public_bytes(serialization.Encoding.PEM), _pem(key)), ends


def check_host(host: str) -> None:
    """UserError: neither an address nor a name that a certificate can carry."""
    _names((host,))


def _names(hosts: tuple[str, ...]) -> list[x509.GeneralName]:
    names: list[x509.GeneralName] = []
    for host in hosts:
        try:
            names.append(x509.IPAddress(ipaddress.ip_address(host)))
            continue
        except ValueError:
            pass
        try:
            if not host or set(host) & set("/: *"):
                raise ValueError("a host name has no '/', ':', '*' or space")
            names.append(x509.DNSName(host))
        except ValueError as error:
            raise UserError(f"--name {host}: give an address or a host name ({error})") from None
    return names


def _name(team: str, common_name: str) -> x509.Name:
    organization = x509.NameAttribute(NameOID.ORGANIZATION_NAME, team)
    return x509.Name([organization, x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _builder(
    name: x509.Name, issuer: x509.Name, public: ec.EllipticCurvePublicKey, number: int, now: float, ends: float
) -> x509.CertificateBuilder:
    builder = x509.CertificateBuilder().subject_name(name).issuer_name(issuer).public_key(public).serial_number(number)
    return builder.not_valid_before(utc(now - EARLIER)).not_valid_after(utc(ends))


def _usage(*, signs: bool) -> x509.KeyUsage:
    """An authority signs certificates and nothing else; everybody else signs handshakes."""
    return x509.KeyUsage(
        digital_signature=not signs,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs,
        crl_sign=signs,
        encipher_only=False,
        decipher_only=False,
    )


def _pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
