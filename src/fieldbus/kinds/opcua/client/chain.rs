//! Certificate of a server with its chain: the server's own certificate, followed by the certificates of its
//! authorities (OPC UA Part 6, 6.2.6).
//!
//! The library parses a certificate only without a chain. The gateway therefore passes only the server's own
//! certificate to the library. The gateway, not the library, decrypts an answer that contains the chain
//! ([`ChainOpener`]).

use std::borrow::Cow;

use ::opcua::crypto::{KeySize, PrivateKey, SecurityPolicy, X509};
use ::opcua::types::{ByteString, EndpointDescription};
use x509_cert::Certificate;
use x509_cert::der::{Decode, Reader, SliceReader};

/// First bytes of the server's answer when a channel is opened: message type `OPN`, and the mark `F` of a complete
/// message.
const OPENED: &[u8] = b"OPNF";
/// Length in bytes of the message header: message type, message length and number of the channel.
const HEADER: usize = 12;
/// Longest key, in bytes, for which one byte contains the length of the padding. A longer key needs two bytes.
const LONG_KEY: usize = 256;

/// Returns the first certificate of a chain in DER form; `None` if it is unreadable.
pub(super) fn leaf(bytes: &[u8]) -> Option<&[u8]> {
    let mut reader = SliceReader::new(bytes).ok()?;
    Certificate::decode(&mut reader).ok()?;
    let end = usize::try_from(reader.position()).ok()?;
    bytes.get(..end)
}

/// Returns the endpoint with the server's own certificate only, without its chain. If the certificate is unreadable,
/// the result has no certificate.
pub(super) fn without_chain(endpoint: EndpointDescription) -> EndpointDescription {
    let own = leaf(endpoint.server_certificate.as_ref());
    let server_certificate = own.map_or_else(ByteString::null, |own| own.to_vec().into());
    EndpointDescription { server_certificate, ..endpoint }
}

/// Opener of the answers with which a server opens or renews a secured channel.
///
/// The signature of such an answer covers the chain, so the chain cannot be removed from it. The opener checks the
/// signature, decrypts the answer, and returns its content as an answer without security, which the library accepts.
/// The keys of the channel are derived from a random number that the gateway has encrypted for the server. Therefore,
/// no other program can use the channel.
///
/// The library itself would accept such an answer without security, or with any certificate. It would also accept such
/// an answer in place of any other message, for example with the values of a read. The opener therefore rejects all
/// answers that are not from this server.
pub(super) struct ChainOpener {
    own: (X509, PrivateKey),
    server: Vec<u8>,
    policy: SecurityPolicy,
}

impl ChainOpener {
    /// Returns an opener for a channel with this security policy. `own` is the certificate of the gateway with its key,
    /// and `server` the certificate of the server.
    pub(super) fn new(own: &(X509, PrivateKey), server: &[u8], policy: SecurityPolicy) -> ChainOpener {
        ChainOpener { own: own.clone(), server: server.to_vec(), policy }
    }

    /// Returns the answer in a form that the library can read. If the answer contains the server's
    /// certificate with its chain, the result is the decrypted content as a message without security. If the
    /// answer contains the certificate without a chain, the result is the unchanged answer: the library
    /// checks its signature with this certificate.
    ///
    /// Returns `None` for all other messages: without security, with another policy or certificate, or with a chain and
    /// a wrong signature.
    pub(super) fn open<'m>(&self, message: &'m [u8]) -> Option<Cow<'m, [u8]>> {
        let mut rest = message.get(HEADER..).filter(|_| message.starts_with(OPENED))?;
        let policy = field(&mut rest)?;
        let (shown, thumbprint) = (field(&mut rest)?, field(&mut rest)?);
        if matches!(self.policy, SecurityPolicy::None | SecurityPolicy::Unknown)
            || policy != self.policy.to_uri().as_bytes()
            || !shown.starts_with(&self.server)
        {
            return None;
        }
        if shown.len() == self.server.len() {
            return Some(Cow::Borrowed(message));
        }
        let (cert, key) = &self.own;
        if thumbprint != cert.thumbprint().value() || !rest.len().is_multiple_of(key.cipher_text_block_size())
        {
            return None;
        }
        let mut plain = vec![0; rest.len()];
        let length = self.policy.asymmetric_decrypt(key, rest, &mut plain).ok()?;
        plain.truncate(length);
        let server = X509::from_der(&self.server).ok()?.public_key().ok()?;
        let (padded, signature) = plain.split_at_checked(plain.len().checked_sub(server.size())?)?;
        let head = message.get(..message.len() - rest.len())?;
        self.policy.asymmetric_verify_signature(&server, &[head, padded].concat(), signature).ok()?;
        let content = padded.get(..padded.len().checked_sub(padding(padded, key.size())?)?)?;
        Some(Cow::Owned(unsecured(message.get(8..HEADER)?, content)))
    }
}

/// Reads a field and the length before it (32 bits, lowest byte first; a negative length means an empty field).
/// Afterwards `rest` begins after the field. Returns `None` if bytes are missing.
fn field<'m>(rest: &mut &'m [u8]) -> Option<&'m [u8]> {
    let (length, after) = rest.split_first_chunk::<4>()?;
    let length = usize::try_from(i32::from_le_bytes(*length)).unwrap_or(0);
    let (field, after) = after.split_at_checked(length)?;
    *rest = after;
    Some(field)
}

/// Returns the number of padding bytes at the end of decrypted content; `None` if the content is too short. `key` is
/// the length of the receiver's key in bytes.
fn padding(padded: &[u8], key: usize) -> Option<usize> {
    let (high, before) = padded.split_last()?;
    if key <= LONG_KEY {
        return Some(usize::from(*high) + 1);
    }
    let low = before.last()?;
    Some(usize::from(u16::from_le_bytes([*low, *high])) + 2)
}

/// Returns a message that opens a channel without security. `channel` is the number of the channel.
fn unsecured(channel: &[u8], content: &[u8]) -> Vec<u8> {
    const NONE: [u8; 4] = [0xff; 4];
    let policy = SecurityPolicy::None.to_uri().as_bytes();
    let number = |length: usize| u32::try_from(length).unwrap_or(u32::MAX).to_le_bytes();
    let length = HEADER + 4 + policy.len() + 2 * NONE.len() + content.len();
    [OPENED, &number(length), channel, &number(policy.len()), policy, &NONE, &NONE, content].concat()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fieldbus::kinds::opcua::client::certificate::{NewCertificate, make};
    use isotherm_core::quantity::Moment;
    use std::time::Duration;

    const POLICIES: [SecurityPolicy; 3] = [
        SecurityPolicy::Basic256Sha256,
        SecurityPolicy::Aes128Sha256RsaOaep,
        SecurityPolicy::Aes256Sha256RsaPss,
    ];

    fn made(name: &str) -> (X509, PrivateKey, Vec<u8>) {
        let now = Moment::from_nanos(1_900_000_000_000_000_000);
        let NewCertificate { cert, key } =
            make(name, "urn:test", "press-7", now, Duration::from_hours(24)).unwrap();
        (X509::from_der(&cert).unwrap(), PrivateKey::from_pem(key.as_bytes()).unwrap(), cert)
    }

    /// Returns the answer of a server that sends the certificate `shown`, with this content, signed with
    /// `key` and encrypted for `to`.
    fn sealed(policy: SecurityPolicy, shown: &[u8], key: &PrivateKey, to: &X509, content: &[u8]) -> Vec<u8> {
        let receiver = to.public_key().unwrap();
        let block = policy.asymmetric_padding_info(&receiver).block_size;
        let fill = (block - (content.len() + 1 + key.size()) % block) % block;
        let filled = u8::try_from(fill).unwrap();
        let plain = [content, &vec![filled; fill + 1]].concat();
        let uri = policy.to_uri().as_bytes();
        let with_length = |bytes: &[u8]| [&u32::try_from(bytes.len()).unwrap().to_le_bytes(), bytes].concat();
        let thumbprint = to.thumbprint().value().to_vec();
        let body =
            [vec![7, 0, 0, 0], with_length(uri), with_length(shown), with_length(&thumbprint)].concat();
        let cipher = policy.calculate_cipher_text_size(plain.len() + key.size(), &receiver);
        let length = u32::try_from(8 + body.len() + cipher).unwrap().to_le_bytes();
        let head = [OPENED, &length, &body].concat();
        let mut signature = vec![0; key.size()];
        policy.asymmetric_sign(key, &[head.as_slice(), &plain].concat(), &mut signature).unwrap();
        let mut encrypted = vec![0; cipher];
        let secret = [plain, signature].concat();
        assert_eq!(policy.asymmetric_encrypt(&receiver, &secret, &mut encrypted).unwrap(), cipher);
        [head, encrypted].concat()
    }

    #[test]
    fn an_answer_with_a_chain_is_opened_if_the_trusted_server_has_signed_it() {
        let (server, server_key, server_der) = made("server");
        let (_, other_key, authority_der) = made("authority");
        let (own, own_key, _) = made("gateway");
        let own_pair = (own.clone(), own_key);
        let chain = [server_der.as_slice(), &authority_der].concat();
        assert_eq!((leaf(&chain), leaf(&server_der)), (Some(server_der.as_slice()), Some(&*server_der)));
        let content: Vec<u8> = (0..200).collect();
        for policy in POLICIES {
            let opener = ChainOpener::new(&own_pair, &server_der, policy);
            let answer = sealed(policy, &chain, &server_key, &own, &content);
            let opened = opener.open(&answer).unwrap();
            assert_eq!((&opened[..4], &opened[8..12]), (OPENED, [7, 0, 0, 0].as_slice()));
            assert_eq!(opened[4..8], u32::try_from(opened.len()).unwrap().to_le_bytes());
            assert!(opened.ends_with(&content) && opened.len() == HEADER + 4 + 47 + 8 + content.len());
            assert!(opened[12..].starts_with(&[47, 0, 0, 0]));
            // Without a chain, the library opens the answer itself.
            let alone = sealed(policy, &server_der, &server_key, &own, &content);
            assert_eq!(opener.open(&alone).as_deref(), Some(alone.as_slice()));
            let wrong = [
                sealed(policy, &chain, &other_key, &own, &content),
                sealed(policy, &chain, &server_key, &server, &content),
                sealed(policy, &[authority_der.as_slice(), &server_der].concat(), &other_key, &own, &content),
            ];
            for answer in wrong {
                assert_eq!(opener.open(&answer), None, "{policy:?}");
            }
            let mut changed = answer.clone();
            changed[8] = 9;
            assert_eq!(opener.open(&changed), None, "the number of the channel is signed too");
            for length in (0..answer.len()).step_by(7) {
                assert_eq!(opener.open(&answer[..length]), None, "{length}");
            }
            assert_eq!(opener.open(b"MSGF\x0c\0\0\0\x07\0\0\0"), None);
        }
    }

    /// Without the opener, the library accepts an answer without security on a secured channel, and an answer
    /// with any certificate.
    #[test]
    fn an_answer_without_security_or_of_another_certificate_or_policy_is_rejected() {
        let (server, server_key, server_der) = made("server");
        let (_, other_key, other_der) = made("other");
        let (own, own_key, _) = made("gateway");
        let [policy, other_policy, _] = POLICIES;
        let opener = ChainOpener::new(&(own.clone(), own_key.clone()), &server_der, policy);
        let wrong = [
            unsecured(&[7, 0, 0, 0], &[0; 40]),
            sealed(policy, &other_der, &other_key, &own, &[0; 40]),
            sealed(other_policy, &server_der, &server_key, &own, &[0; 40]),
            sealed(other_policy, &[&*server_der, &other_der].concat(), &server_key, &own, &[0; 40]),
        ];
        for answer in wrong {
            assert_eq!(opener.open(&answer), None);
        }
        let plain = ChainOpener::new(&(server, own_key), &[], SecurityPolicy::None);
        assert_eq!(plain.open(&unsecured(&[7, 0, 0, 0], &[0; 40])), None, "there is no certificate");
    }

    #[test]
    fn an_endpoint_keeps_the_server_s_own_certificate_alone() {
        let (_, _, server) = made("server");
        let shown = |bytes: &[u8]| {
            let endpoint =
                EndpointDescription { server_certificate: bytes.to_vec().into(), ..Default::default() };
            without_chain(endpoint).server_certificate
        };
        for bytes in [[server.as_slice(), &server].concat(), server.clone()] {
            assert_eq!(shown(&bytes).value.as_deref(), Some(server.as_slice()));
        }
        assert!(shown(b"no certificate").is_null_or_empty() && shown(&[]).is_null_or_empty());
    }
}
