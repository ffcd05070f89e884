"""Makes certificates as OPC UA wants them, in the directory that is named: own, server, old (expired), soon (expires in 20
days), user, other, each with its key.

--thumbprints FILE   prints the SHA-1 and SHA-256 of a certificate, and from when to when it is valid
--renew DIRECTORY    makes another one for soon, valid for longer
--early DIRECTORY    makes early (valid in a year)
--others DIRECTORY   makes authority, chained (a server's, signed by the authority), and short (a server's, with 1024 bits)
"""

import sys
from datetime import datetime, timedelta, timezone
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

if sys.argv[1] == "--thumbprints":
    cert = x509.load_der_x509_certificate(Path(sys.argv[2]).read_bytes())
    times = (cert.not_valid_before_utc, cert.not_valid_after_utc)
    print(cert.fingerprint(hashes.SHA1()).hex(), cert.fingerprint(hashes.SHA256()).hex())
    print(*(time.strftime("%Y-%m-%dT%H:%M:%SZ") for time in times))
    sys.exit()
NOW = datetime.now(timezone.utc)
YEAR = timedelta(days=365)
into = Path(sys.argv[-1])


def make(name, uri, begin, end, of=None, by=None, bits=2048):
    """Returns the key and the subject. `by` are those of an authority."""
    key = rsa.generate_private_key(public_exponent=65537, key_size=bits)
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, of or name)])
    usage = x509.KeyUsage(True, True, True, True, False, True, False, False, False)
    uses = [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]
    names = [x509.UniformResourceIdentifier(uri), x509.DNSName("localhost")]
    cert = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(by[1] if by else subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(begin)
        .not_valid_after(end)
        .add_extension(x509.SubjectAlternativeName(names), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(usage, critical=True)
        .add_extension(x509.ExtendedKeyUsage(uses), critical=False)
        .sign(by[0] if by else key, hashes.SHA256())
    )
    secret = serialization.NoEncryption()
    form = serialization.PrivateFormat.PKCS8
    (into / f"{name}.pem").write_bytes(key.private_bytes(serialization.Encoding.PEM, form, secret))
    (into / f"{name}.der").write_bytes(cert.public_bytes(serialization.Encoding.DER))
    return key, subject


if sys.argv[1] == "--renew":
    make("renewed", "urn:isotherm:test", NOW - YEAR, NOW + YEAR, of="soon")
    sys.exit()
if sys.argv[1] == "--others":
    authority = make("authority", "urn:isotherm:authority", NOW - YEAR, NOW + YEAR)
    make("chained", "urn:freeopcua:python:server", NOW - YEAR, NOW + YEAR, by=authority)
    make("short", "urn:freeopcua:python:server", NOW - YEAR, NOW + YEAR, bits=1024)
    sys.exit()
if sys.argv[1] == "--early":
    make("early", "urn:isotherm:test", NOW + YEAR, NOW + 2 * YEAR)
    sys.exit()
make("own", "urn:isotherm:test", NOW - YEAR, NOW + YEAR)
make("server", "urn:freeopcua:python:server", NOW - YEAR, NOW + YEAR)
make("old", "urn:isotherm:test", NOW - 2 * YEAR, NOW - YEAR)
make("soon", "urn:isotherm:test", NOW - YEAR, NOW + timedelta(days=20))
make("user", "urn:isotherm:user", NOW - YEAR, NOW + YEAR)
make("other", "urn:isotherm:user", NOW - YEAR, NOW + YEAR)
