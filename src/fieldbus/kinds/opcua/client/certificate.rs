//! Content of OPC UA certificates, for a comparison by the user, and creation of a certificate for the gateway.

use std::fmt::Write;
use std::time::Duration;

use ::opcua::crypto::KeySize;
use isotherm_core::quantity::Moment;
use isotherm_profile::{counted, sha256};
use rsa::pkcs1v15::SigningKey;
use rsa::pkcs8::{EncodePrivateKey, EncodePublicKey, LineEnding};
use rsa::rand_core::{OsRng, RngCore};
use rsa::sha2::Sha256;
use rsa::{RsaPrivateKey, RsaPublicKey};
use serde::Serialize;
use x509_cert::Certificate as Parsed;
use x509_cert::builder::{Builder, CertificateBuilder, Error, Profile};
use x509_cert::der::asn1::{GeneralizedTime, Ia5String, ObjectIdentifier, UtcTime};
use x509_cert::der::referenced::OwnedToRef;
use x509_cert::der::{Decode, Encode};
use x509_cert::ext::pkix::name::GeneralName;
use x509_cert::ext::pkix::{
    AuthorityKeyIdentifier, BasicConstraints, ExtendedKeyUsage, KeyUsage, KeyUsages, SubjectAltName,
    SubjectKeyIdentifier,
};
use x509_cert::name::Name;
use x509_cert::serial_number::SerialNumber;
use x509_cert::spki::SubjectPublicKeyInfoOwned;
use x509_cert::time::{Time, Validity};

use super::files::{application, certificate};

/// Key length in bits. Every supported security policy accepts a key of this length, and even the computer of a small
/// control can process such a key.
const KEY_BITS: usize = 2048;
/// Time from the beginning of the validity of a new certificate to its creation. The validity begins earlier,
/// because the clock of a control may be slow.
const EARLIER: Duration = Duration::from_hours(24);
/// Object identifier of the extended key usage "TLS client authentication", which OPC UA requires of a client.
const OF_A_CLIENT: ObjectIdentifier = ObjectIdentifier::new_unwrap("1.3.6.1.5.5.7.3.2");
/// Object identifier of the extended key usage "TLS server authentication", which OPC UA requires of a server.
const OF_A_SERVER: ObjectIdentifier = ObjectIdentifier::new_unwrap("1.3.6.1.5.5.7.3.1");
/// Shortest RSA key, in bits, that counts as safe. The security policies that the gateway supports also require this
/// length.
const SAFE_BITS: usize = 2048;
/// Object identifiers of signatures with a broken digest, and the name of the digest.
const BROKEN_DIGESTS: [(ObjectIdentifier, &str); 4] = [
    (ObjectIdentifier::new_unwrap("1.2.840.113549.1.1.5"), "SHA-1"),
    (ObjectIdentifier::new_unwrap("1.2.840.10045.4.1"), "SHA-1"),
    (ObjectIdentifier::new_unwrap("1.2.840.113549.1.1.4"), "MD5"),
    (ObjectIdentifier::new_unwrap("1.2.840.113549.1.1.2"), "MD2"),
];
const SHA1_DIGITS: usize = 40;
const SHA256_DIGITS: usize = 64;

/// Content of a certificate that users see and compare, for example the thumbprint.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Certificate {
    /// Subject of the certificate as text: the name of its owner.
    pub subject: String,
    /// URI of the OPC UA application in the certificate; `None` if the certificate has no such URI.
    pub application: Option<String>,
    /// SHA-1 digest of the certificate, which servers and OPC UA browsers display.
    pub thumbprint: String,
    /// SHA-256 digest of the certificate, which newer programs display.
    pub sha256: String,
    /// Time at which the certificate becomes valid.
    #[serde(serialize_with = "in_text")]
    pub from: Moment,
    /// Time at which the certificate expires.
    #[serde(serialize_with = "in_text")]
    pub to: Moment,
    /// Length of the RSA key in bits; `None` if the key is not an RSA key.
    pub key_bits: Option<usize>,
    /// Name of the digest of the signature if this digest is broken, for example `SHA-1`; otherwise `None`.
    pub broken_digest: Option<&'static str>,
    /// Whole certificate in DER form.
    #[serde(skip)]
    pub der: Vec<u8>,
}

/// New certificate, with its private key.
pub struct NewCertificate {
    /// The certificate, in DER form.
    pub cert: Vec<u8>,
    /// The private key, in PEM form.
    pub key: String,
}

fn in_text<S: serde::Serializer>(at: &Moment, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(at)
}

impl Certificate {
    /// Reads a certificate in DER or PEM form; returns `None` if it is unreadable. In DER form, the certificates of its
    /// authorities may follow.
    pub fn read(bytes: &[u8]) -> Option<Certificate> {
        let parsed = certificate(bytes)?;
        let der = parsed.to_der().ok()?;
        let content = Parsed::from_der(&der).ok()?;
        let validity = content.tbs_certificate.validity;
        let digest =
            BROKEN_DIGESTS.iter().find(|(signature, _)| *signature == content.signature_algorithm.oid);
        let at = |time: Time| {
            Moment::from_nanos(u64::try_from(time.to_unix_duration().as_nanos()).unwrap_or(u64::MAX))
        };
        let digits = parsed.thumbprint().value().iter().fold(String::new(), |mut text, byte| {
            let _ = write!(text, "{byte:02x}");
            text
        });
        Some(Certificate {
            subject: parsed.subject_name(),
            application: application(&parsed),
            thumbprint: in_pairs(&digits),
            sha256: in_pairs(&sha256(&der)),
            from: at(validity.not_before),
            to: at(validity.not_after),
            key_bits: parsed.public_key().ok().map(|key| key.bit_length()),
            broken_digest: digest.map(|(_, name)| *name),
            der,
        })
    }

    /// Formats the content of the certificate, one item on each line. `now` is the wall-clock time.
    pub fn text(&self, now: Moment) -> String {
        let Certificate { subject, application, thumbprint, sha256, .. } = self;
        let mut text = format!("  subject      {subject}\n");
        if let Some(application) = application {
            let _ = writeln!(text, "  application  {application}");
        }
        let _ = writeln!(text, "  thumbprint   {thumbprint} (SHA-1)");
        let _ = writeln!(text, "  or           {sha256} (SHA-256)");
        let _ = writeln!(text, "  valid        {}", self.validity(now));
        if let Some(weakness) = self.weakness() {
            let _ = writeln!(text, "  warning      {weakness}: {SAFE_BITS} bits and SHA-256 are safe");
        }
        text
    }

    /// Returns whether the key is too short for the security policies without SHA-1.
    pub fn has_short_key(&self) -> bool {
        self.key_bits.is_some_and(|bits| bits < SAFE_BITS)
    }

    /// Returns why the certificate is weak, for example `the key has 1024 bits`; `None` if it is not weak.
    pub fn weakness(&self) -> Option<String> {
        let bits = self.key_bits.filter(|bits| *bits < SAFE_BITS);
        let bits = bits.map(|bits| format!("the key has {bits} bits"));
        let digest = self.broken_digest.map(|digest| format!("the signature uses {digest}"));
        match (bits, digest) {
            (Some(bits), Some(digest)) => Some(format!("{bits}, and {digest}")),
            (bits, digest) => bits.or(digest),
        }
    }

    /// Formats the period of validity of the certificate, and the number of days that are left.
    fn validity(&self, now: Moment) -> String {
        const DAY: Duration = Duration::from_hours(24);
        let day = |moment: Moment| moment.to_string().chars().take(10).collect::<String>();
        let how = match now {
            _ if now < self.from => "not valid yet, or this computer's clock is wrong".to_owned(),
            _ if now > self.to => "expired, or this computer's clock is wrong".to_owned(),
            _ => format!("{} left", counted(self.to.since(now).as_secs() / DAY.as_secs(), "day")),
        };
        format!("{} to {}: {how}", day(self.from), day(self.to))
    }

    /// Returns whether `text` is the thumbprint of the certificate, SHA-1 or SHA-256, in any usual notation.
    ///
    /// # Errors
    /// A sentence for the user, if the text is not a thumbprint.
    pub fn has_thumbprint(&self, text: &str) -> Result<bool, String> {
        let text = text.trim();
        let digits = text.strip_prefix("0x").unwrap_or(text);
        let digits: String = digits.chars().filter(|c| !matches!(c, ':' | ' ' | '-')).collect();
        let known = match digits.len() {
            SHA1_DIGITS => &self.thumbprint,
            SHA256_DIGITS => &self.sha256,
            _ => "",
        };
        if known.is_empty() || !digits.chars().all(|c| c.is_ascii_hexdigit()) {
            return Err(format!(
                "`{text}` is not a thumbprint: a thumbprint has {SHA1_DIGITS} hexadecimal digits (SHA-1), or \
                 {SHA256_DIGITS} (SHA-256)"
            ));
        }
        Ok(known.replace(':', "").eq_ignore_ascii_case(&digits))
    }
}

/// Formats hexadecimal digits in pairs with colons, for example `5F3A…` as `5F:3A:…`.
fn in_pairs(digits: &str) -> String {
    let digits = digits.to_uppercase();
    let pairs = digits.as_bytes().chunks(2).map(String::from_utf8_lossy);
    pairs.collect::<Vec<_>>().join(":")
}

/// Creates a certificate for this subject, application URI and host, signed with its own key. Returns the certificate
/// with this key.
///
/// # Errors
/// A sentence for the user, if a name is not allowed in a certificate, or the system provides no random numbers.
pub fn make(
    subject: &str,
    application: &str,
    host: &str,
    now: Moment,
    lasts: Duration,
) -> Result<NewCertificate, String> {
    let key = RsaPrivateKey::new(&mut OsRng, KEY_BITS)
        .map_err(|why| format!("the private key could not be created: {why}"))?;
    let cert = signed(&key, subject, application, host, [now.before(EARLIER), now.after(lasts)]);
    let cert = cert.map_err(|why| format!("the certificate could not be created: {why}"))?;
    let key = key
        .to_pkcs8_pem(LineEnding::LF)
        .map_err(|why| format!("the private key could not be encoded: {why}"))?;
    Ok(NewCertificate { cert, key: key.to_string() })
}

fn signed(
    key: &RsaPrivateKey,
    subject: &str,
    application: &str,
    host: &str,
    valid: [Moment; 2],
) -> Result<Vec<u8>, Error> {
    let [not_before, not_after] = valid.map(time);
    let validity = Validity { not_before: not_before?, not_after: not_after? };
    let public = RsaPublicKey::from(key).to_public_key_der().map_err(Error::PublicKey)?;
    let public = SubjectPublicKeyInfoOwned::try_from(public.as_bytes()).map_err(Error::PublicKey)?;
    let name: Name = format!("CN={subject}").parse()?;
    let mut serial = [0; 16];
    OsRng.fill_bytes(&mut serial);
    // A serial number is positive, and its first byte is not zero.
    serial[0] = serial[0] & 0x7f | 0x40;
    let signer = SigningKey::<Sha256>::new(key.clone());
    let profile = Profile::Manual { issuer: None };
    let serial = SerialNumber::new(&serial)?;
    let mut builder = CertificateBuilder::new(profile, serial, validity, name, public.clone(), &signer)?;
    builder.add_extension(&SubjectKeyIdentifier::try_from(public.owned_to_ref())?)?;
    builder.add_extension(&AuthorityKeyIdentifier::try_from(public.owned_to_ref())?)?;
    builder.add_extension(&BasicConstraints { ca: false, path_len_constraint: None })?;
    // Usages that OPC UA Part 6 requires of a self-signed certificate.
    let usages = KeyUsages::DigitalSignature
        | KeyUsages::NonRepudiation
        | KeyUsages::KeyEncipherment
        | KeyUsages::DataEncipherment
        | KeyUsages::KeyCertSign;
    builder.add_extension(&KeyUsage(usages))?;
    builder.add_extension(&ExtendedKeyUsage(vec![OF_A_CLIENT, OF_A_SERVER]))?;
    builder.add_extension(&SubjectAltName(vec![
        GeneralName::UniformResourceIdentifier(Ia5String::new(application)?),
        GeneralName::DnsName(Ia5String::new(host)?),
    ]))?;
    Ok(builder.build()?.to_der()?)
}

/// Encodes a time as RFC 5280 requires: UTCTime until 2049, GeneralizedTime after that.
fn time(at: Moment) -> Result<Time, x509_cert::der::Error> {
    let seconds = Duration::from_secs(at.as_nanos() / 1_000_000_000);
    match UtcTime::from_unix_duration(seconds) {
        Ok(short) => Ok(Time::UtcTime(short)),
        Err(_) => GeneralizedTime::from_unix_duration(seconds).map(Time::GeneralTime),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DAY: Duration = Duration::from_hours(24);

    #[test]
    fn a_short_key_and_a_broken_digest_are_named_and_the_certificate_is_read_anyway() {
        let now = Moment::from_nanos(1_900_000_000_000_000_000);
        let with_key = |bits| {
            let key = RsaPrivateKey::new(&mut OsRng, bits).unwrap();
            signed(&key, "old", "urn:old", "press-7", [now, now.after(10 * DAY)]).unwrap()
        };
        // The object identifier of SHA-256 with RSA, and the one of SHA-1 with RSA, differ in the last byte.
        let with_sha1 = |mut der: Vec<u8>| {
            const SHA256_RSA: &[u8] = b"\x2a\x86\x48\x86\xf7\x0d\x01\x01\x0b";
            let places: Vec<usize> =
                (0..der.len()).filter(|place| der[*place..].starts_with(SHA256_RSA)).collect();
            assert_eq!(places.len(), 2);
            places.into_iter().for_each(|place| der[place + 8] = 5);
            der
        };
        let (short, long) = (with_key(1024), with_key(2048));
        let cases = [
            (long.clone(), Some(2048), None),
            (short.clone(), Some(1024), Some("the key has 1024 bits")),
            (with_sha1(long), Some(2048), Some("the signature uses SHA-1")),
            (with_sha1(short), Some(1024), Some("the key has 1024 bits, and the signature uses SHA-1")),
        ];
        for (der, bits, weakness) in cases {
            let read = Certificate::read(&der).unwrap();
            assert_eq!((read.key_bits, read.weakness().as_deref()), (bits, weakness));
            assert_eq!(
                read.text(now).contains("  warning      the"),
                weakness.is_some(),
                "{}",
                read.text(now)
            );
        }
    }

    #[test]
    fn a_certificate_that_was_made_says_for_whom_how_long_and_by_which_thumbprints() {
        let now = Moment::from_nanos(1_900_000_000_000_000_000);
        let made = make("isotherm lathe", "urn:press-7:isotherm:lathe", "press-7", now, 10 * DAY).unwrap();
        let read = Certificate::read(&made.cert).unwrap();
        assert_eq!(read.subject, "CN=isotherm lathe");
        assert_eq!(read.application.as_deref(), Some("urn:press-7:isotherm:lathe"));
        assert_eq!((read.from, read.to), (now.before(DAY), now.after(10 * DAY)));
        assert!(made.key.starts_with("-----BEGIN PRIVATE KEY-----"));
        let behind = [made.cert.as_slice(), b"\x30\x00"].concat();
        assert_eq!(Certificate::read(&behind).unwrap(), read, "what follows are its authorities");
        let other = make("isotherm lathe", "urn:press-7:isotherm:lathe", "press-7", now, 10 * DAY).unwrap();
        assert_ne!(Certificate::read(&other.cert).unwrap().thumbprint, read.thumbprint);
        assert_eq!(read.thumbprint.len(), SHA1_DIGITS / 2 * 3 - 1);
        let plain = read.thumbprint.replace(':', "");
        for written in
            [read.thumbprint.clone(), plain.to_lowercase(), format!("0x{plain}"), read.sha256.clone()]
        {
            assert_eq!(read.has_thumbprint(&written), Ok(true), "{written}");
        }
        let digit = if plain.starts_with('0') { '1' } else { '0' };
        assert_eq!(read.has_thumbprint(&format!("{digit}{}", &plain[1..])), Ok(false));
        assert!(read.has_thumbprint("5F3A").unwrap_err().contains("40 hexadecimal digits"));
    }
}
