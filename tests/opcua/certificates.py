"""Makes certificates as OPC UA wants them, in the directory that is named: own, server, old (expired), each with its key."""

import sys
from datetime import datetime, timedelta, timezone
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

NOW = datetime.now(timezone.utc)
into = Path(sys.argv[1])


def make(name, uri, begin, end):
    key = rsa.generate_private_key(public_exponent=65537, key_size=2048)
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    usage = x509.KeyUsage(True, True, True, True, False, True, False, False, False)
    uses = [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]
    names = [x509.UniformResourceIdentifier(uri), x509.DNSName("localhost")]
    cert = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(begin)
        .not_valid_after(end)
        .add_extension(x509.SubjectAlternativeName(names), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(usage, critical=True)
        .add_extension(x509.ExtendedKeyUsage(uses), critical=False)
        .sign(key, hashes.SHA256())
    )
    secret = serialization.NoEncryption()
    form = serialization.PrivateFormat.PKCS8
    (into / f"{name}.pem").write_bytes(key.private_bytes(serialization.Encoding.PEM, form, secret))
    (into / f"{name}.der").write_bytes(cert.public_bytes(serialization.Encoding.DER))


YEAR = timedelta(days=365)
make("own", "urn:isotherm:test", NOW - YEAR, NOW + YEAR)
make("server", "urn:freeopcua:python:server", NOW - YEAR, NOW + YEAR)
make("old", "urn:isotherm:test", NOW - 2 * YEAR, NOW - YEAR)
