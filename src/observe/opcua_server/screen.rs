//! Filter for the messages of a client. The filter reads the part of each message that is not encrypted, before the
//! library reads the message. It refuses requests that no endpoint offers.
//!
//! The library opens a channel with every policy that it knows. The library creates sessions before a client has logged
//! in. When it rejects a channel, it may read further messages before it closes that channel. Without this filter:
//!
//! - a client could announce a message of 4 GB, and the library would store all its bytes until the last byte has
//!   arrived;
//! - a client that is not trusted could take all sessions of a secured server, so that no other client could log in;
//! - an attacker on the network could renew the channel of a client with another certificate, and send messages over
//!   that channel;
//! - any client could request decryptions with the padding of Basic128Rsa15, whose error messages reveal decrypted
//!   data.
//!
//! After the messages HEL and OPN, nothing is forwarded until the library has answered. Therefore the filter and the
//! library always use the same policy for a message.

use std::sync::Arc;

use ::opcua::crypto::SecurityPolicy;

use super::setup::{CHUNK, POLICIES};
use isotherm_profile::Security;

/// Length of the header of a message, bytes: message type, chunk type and size.
const HEADER: usize = 8;
/// Offsets in a message, bytes: of the size, of the length of the policy, of the policy, and of the identifier of a
/// request.
const SIZE_AT: usize = 4;
const LENGTH_AT: usize = 12;
const POLICY_AT: usize = 16;
const REQUEST_AT: usize = 24;
/// Maximum length of the URI of a policy, in bytes.
const LONGEST: usize = 255;
/// Maximum number of bytes after the client's certificate in a message that opens a channel. These bytes are the digest
/// of the server's certificate, and two or three encrypted blocks of 256 or 512 bytes.
const MOST_DECRYPTED: usize = 2_100;
/// Identifiers of the requests FindServers and GetEndpoints, with which a client asks for the endpoints of a server.
const DISCOVERY: [u16; 2] = [422, 428];

/// Policies that the endpoints of a server offer, and the clients that it trusts.
#[derive(Debug)]
pub(super) struct Rules {
    /// URIs of the security policies. The list is empty if the server has no security.
    policies: Vec<&'static str>,
    /// Certificates of the trusted clients in DER form.
    trusted: Vec<Vec<u8>>,
}

impl Rules {
    /// Returns the rules of a server with these security settings, which trusts the clients with these certificates.
    pub(super) fn of(security: Security, trusted: &[Vec<u8>]) -> Rules {
        let policies: &[SecurityPolicy] = match security {
            Security::None => &[],
            Security::Sign | Security::SignAndEncrypt => &POLICIES,
        };
        let policies = policies.iter().map(SecurityPolicy::to_uri).collect();
        Rules { policies, trusted: trusted.to_vec() }
    }
}

/// Protection of the secure channel that a client has opened on its connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Channel {
    /// No channel is open yet.
    None,
    /// Messages are neither signed nor encrypted.
    Plain,
    /// Messages are signed, and may be encrypted, with this policy.
    Secured(&'static str),
}

/// Next step of the gate after some bytes were forwarded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Then {
    /// The gate may forward further bytes.
    GoOn,
    /// The gate must wait until the library has answered.
    Wait,
    /// The gate must wait until the library has answered. The answer needs much processor time.
    Open,
}

/// Reason why the gate refuses a message and closes the connection.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Refusal {
    /// The bytes are not an OPC UA message.
    NoMessage,
    /// A message is larger than the maximum size that the server has stated.
    TooLarge,
    /// No endpoint offers the security policy that the client uses.
    Policy,
    /// The client with this certificate is not trusted.
    Untrusted(Vec<u8>),
    /// The client sends a request without security that is permitted only on a secure channel.
    Plain,
}

impl Refusal {
    /// Returns the OPC UA error message that states this reason.
    pub(super) fn message(&self) -> Vec<u8> {
        let (status, why): (u32, &str) = match self {
            Refusal::NoMessage => (0x807E_0000, "the bytes are not an OPC UA message"),
            Refusal::TooLarge => (0x8080_0000, "a chunk of a message is larger than negotiated"),
            Refusal::Policy => (0x8055_0000, "no endpoint of this server offers this security policy"),
            Refusal::Untrusted(_) => {
                (0x801A_0000, "this server does not trust the certificate of the client")
            }
            Refusal::Plain => (0x8013_0000, "this server requires security: choose one of its endpoints"),
        };
        let length = u32::try_from(why.len()).unwrap_or(u32::MAX);
        let size = length.saturating_add(16);
        let numbers = [size, status, length].map(u32::to_le_bytes).concat();
        [&b"ERRF"[..], &numbers[..], why.as_bytes()].concat()
    }
}

/// Filter for the messages that the client of one connection sends.
#[derive(Debug)]
pub(super) struct Screen {
    rules: Arc<Rules>,
    channel: Channel,
    /// First bytes of a message that is not checked yet.
    head: Vec<u8>,
    /// Number of bytes of an accepted message that have not arrived yet.
    left: usize,
    /// Next step of the gate after the end of the present message.
    then: Then,
}

impl Screen {
    pub(super) fn new(rules: Arc<Rules>) -> Screen {
        Screen { rules, channel: Channel::None, head: Vec::new(), left: 0, then: Then::GoOn }
    }

    /// Appends the bytes that may be forwarded to `passed`. Returns the number of bytes that were used, and the next
    /// step.
    ///
    /// # Errors
    /// The connection must be closed, for the reason in the error.
    pub(super) fn pass(&mut self, bytes: &[u8], passed: &mut Vec<u8>) -> Result<(usize, Then), Refusal> {
        let mut rest = bytes;
        while let Some((first, later)) = rest.split_first() {
            if self.left > 0 {
                let (now, later) = rest.split_at(self.left.min(rest.len()));
                passed.extend_from_slice(now);
                self.left -= now.len();
                rest = later;
            } else {
                self.head.push(*first);
                rest = later;
                let Some(size) = self.judge()? else { continue };
                self.left = size - self.head.len();
                passed.append(&mut self.head);
            }
            if self.left == 0 && self.then != Then::GoOn {
                return Ok((bytes.len() - rest.len(), self.then));
            }
        }
        Ok((bytes.len(), Then::GoOn))
    }

    /// Checks the message that begins with `head`. Returns its size if it may be forwarded; `None` if more bytes are
    /// needed for the check. The size is never below the length of `head`.
    fn judge(&mut self) -> Result<Option<usize>, Refusal> {
        let Some(size) = number(&self.head, SIZE_AT) else { return Ok(None) };
        let kind: [u8; 3] = self.head.first_chunk().copied().unwrap_or_default();
        let is_judged = match &kind {
            _ if size < HEADER => return Err(Refusal::NoMessage),
            b"HEL" | b"OPN" | b"MSG" | b"CLO" if size > CHUNK => return Err(Refusal::TooLarge),
            b"HEL" | b"CLO" => true,
            b"OPN" => self.opens(size)?,
            b"MSG" => self.asks()?,
            _ => return Err(Refusal::NoMessage),
        };
        if !is_judged {
            return if self.head.len() < size { Ok(None) } else { Err(Refusal::NoMessage) };
        }
        self.then = match (&kind, self.channel) {
            (b"OPN", Channel::Secured(_)) => Then::Open,
            (b"OPN" | b"HEL", _) => Then::Wait,
            _ => Then::GoOn,
        };
        Ok(Some(size))
    }

    /// Checks a message of `size` bytes that opens a channel: its policy, its certificate and its length.
    /// Returns `false` if policy or certificate have not arrived completely. The error is the reason to close
    /// the connection.
    fn opens(&mut self, size: usize) -> Result<bool, Refusal> {
        let Some(length) = number(&self.head, LENGTH_AT) else { return Ok(false) };
        if length > LONGEST {
            return Err(Refusal::Policy);
        }
        let Some(uri) = self.head.get(POLICY_AT..POLICY_AT + length) else { return Ok(false) };
        let known = self.rules.policies.iter().copied().find(|known| known.as_bytes() == uri);
        let channel = match known {
            Some(policy) => Channel::Secured(policy),
            None if uri == SecurityPolicy::None.to_uri().as_bytes() => Channel::Plain,
            None => return Err(Refusal::Policy),
        };
        if known.is_some() {
            let certificate_at = POLICY_AT + length + 4;
            let Some(certificate) = number(&self.head, POLICY_AT + length) else { return Ok(false) };
            match size.checked_sub(certificate_at).and_then(|left| left.checked_sub(certificate)) {
                None => return Err(Refusal::NoMessage),
                Some(MOST_DECRYPTED..) => return Err(Refusal::TooLarge),
                Some(_) => {}
            }
            let Some(sender) = self.head.get(certificate_at..certificate_at + certificate) else {
                return Ok(false);
            };
            // The certificates of authorities may follow.
            if !self.rules.trusted.iter().any(|known| sender.starts_with(known)) {
                return Err(Refusal::Untrusted(sender.to_vec()));
            }
        }
        // A channel keeps its policy when it is renewed.
        if self.channel != Channel::None && self.channel != channel {
            return Err(Refusal::Policy);
        }
        self.channel = channel;
        Ok(true)
    }

    /// Checks a request. Returns `true` if the channel permits the request, and `false` if the identifier of
    /// the request has not arrived yet. The error is the reason to close the connection.
    fn asks(&self) -> Result<bool, Refusal> {
        match self.channel {
            Channel::None => Err(Refusal::NoMessage),
            Channel::Secured(_) => Ok(true),
            Channel::Plain if self.rules.policies.is_empty() => Ok(true),
            // A request in several parts is longer than any of those that are allowed.
            Channel::Plain if self.head[3] != b'F' => Err(Refusal::Plain),
            Channel::Plain => match self.head.get(REQUEST_AT..REQUEST_AT + 4) {
                // Two bytes are the form and the namespace of the identifier, two its number.
                Some(&[1, 0, low, high]) if DISCOVERY.contains(&u16::from_le_bytes([low, high])) => Ok(true),
                Some(_) => Err(Refusal::Plain),
                None => Ok(false),
            },
        }
    }
}

/// Returns the 32-bit number at the offset `at`; `None` if not all of its bytes have arrived.
fn number(bytes: &[u8], at: usize) -> Option<usize> {
    let number = bytes.get(at..)?.first_chunk()?;
    usize::try_from(u32::from_le_bytes(*number)).ok()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use proptest::prelude::*;

    const BASIC: &str = "http://opcfoundation.org/UA/SecurityPolicy#Basic256Sha256";
    const SHA1: &str = "http://opcfoundation.org/UA/SecurityPolicy#Basic128Rsa15";
    const NONE: &str = "http://opcfoundation.org/UA/SecurityPolicy#None";

    /// Makes a message with this content after its header.
    pub(in super::super) fn message(kind: &str, content: &[u8]) -> Vec<u8> {
        let size = u32::try_from(HEADER + content.len()).unwrap().to_le_bytes();
        [kind.as_bytes(), &size[..], content].concat()
    }

    fn hello() -> Vec<u8> {
        message("HELF", &[0; 24])
    }

    /// Certificate of a trusted client.
    const OWN: [u8; 900] = [7; 900];

    fn opening(policy: &str) -> Vec<u8> {
        opening_with(policy, &OWN, 600)
    }

    /// Makes a message that opens a channel, with this certificate, and with `encrypted` bytes after the
    /// certificate.
    fn opening_with(policy: &str, certificate: &[u8], encrypted: usize) -> Vec<u8> {
        let length = u32::try_from(policy.len()).unwrap().to_le_bytes();
        let size = u32::try_from(certificate.len()).unwrap().to_le_bytes();
        let plain = [&[0; 4][..], &length[..], policy.as_bytes(), &size[..], certificate].concat();
        message("OPNF", &[plain, vec![8; encrypted]].concat())
    }

    fn screen(security: Security) -> Screen {
        Screen::new(Arc::new(Rules::of(security, &[vec![1; 900], OWN.to_vec()])))
    }

    fn request(kind: &str, number: u16) -> Vec<u8> {
        message(kind, &[&[5; 16][..], &[1, 0][..], &number.to_le_bytes()[..], &[9; 30][..]].concat())
    }

    /// Passes messages through the filter in pieces of `piece` bytes. Returns the forwarded bytes, and the
    /// refusal.
    fn passed(security: Security, messages: &[Vec<u8>], piece: usize) -> (Vec<u8>, Option<Refusal>) {
        let mut screen = screen(security);
        let mut passed = Vec::new();
        for piece in messages.concat().chunks(piece) {
            let mut rest = piece;
            while !rest.is_empty() {
                match screen.pass(rest, &mut passed) {
                    Ok((used, _)) => rest = &rest[used..],
                    Err(refusal) => return (passed, Some(refusal)),
                }
            }
        }
        (passed, None)
    }

    #[test]
    fn a_secured_server_gets_what_its_endpoints_offer_and_questions_about_them_only() {
        let (create_session, read, other) = (461, 631, vec![6; 900]);
        for (messages, refusal) in [
            (vec![opening(BASIC), request("MSGF", read), request("MSGC", 1), request("CLOF", 452)], None),
            (vec![opening(BASIC), request("MSGF", read), opening(BASIC)], None),
            (vec![opening(NONE), request("MSGF", 428), request("MSGF", 422), request("CLOF", 452)], None),
            (vec![opening(NONE), request("MSGF", create_session)], Some(Refusal::Plain)),
            (vec![opening(NONE), request("MSGC", 428)], Some(Refusal::Plain)),
            (vec![opening(NONE), request("MSGF", read)], Some(Refusal::Plain)),
            (vec![opening(SHA1)], Some(Refusal::Policy)),
            (vec![opening("")], Some(Refusal::Policy)),
            (vec![opening(&"x".repeat(300))], Some(Refusal::Policy)),
            (vec![opening(NONE), opening(BASIC)], Some(Refusal::Policy)),
            (vec![opening_with(BASIC, &OWN, MOST_DECRYPTED - 1)], None),
            (vec![opening_with(BASIC, &OWN, MOST_DECRYPTED)], Some(Refusal::TooLarge)),
            (vec![opening_with(BASIC, &[7; 1200], 600)], None),
            (vec![opening_with(BASIC, &other, 600)], Some(Refusal::Untrusted(other.clone()))),
            (vec![opening_with(BASIC, &OWN[1..], 600)], Some(Refusal::Untrusted(OWN[1..].to_vec()))),
            (vec![opening(BASIC), opening_with(BASIC, &other, 600)], Some(Refusal::Untrusted(other.clone()))),
            (vec![message("OPNF", &opening(BASIC)[HEADER..700])], Some(Refusal::NoMessage)),
            (vec![request("MSGF", create_session)], Some(Refusal::NoMessage)),
            (vec![b"GET / HTTP/1.1\r\n\r\n".to_vec()], Some(Refusal::NoMessage)),
            (vec![b"OPNF\x0a\0\0\0\0\0\0\0".to_vec()], Some(Refusal::NoMessage)),
            (vec![b"HELF\x07\0\0\0".to_vec()], Some(Refusal::NoMessage)),
            (vec![message("CLOF", &vec![1; CHUNK - HEADER])], None),
            (vec![message("CLOF", &vec![1; CHUNK - HEADER + 1])], Some(Refusal::TooLarge)),
            (vec![b"HELF\xff\xff\xff\xff".to_vec()], Some(Refusal::TooLarge)),
        ] {
            let messages = [vec![hello()], messages].concat();
            let (found, why) = passed(Security::SignAndEncrypt, &messages, 4096);
            assert_eq!(why, refusal, "{messages:?}");
            let allowed = if why.is_none() { messages.concat() } else { found.clone() };
            assert_eq!(found, allowed);
        }
    }

    #[test]
    fn a_server_without_security_gets_every_request_and_no_other_policy() {
        let all = [hello(), opening(NONE), request("MSGF", 461), request("MSGC", 631)];
        assert_eq!(passed(Security::None, &all, 4096), (all.concat(), None));
        let (_, why) = passed(Security::None, &[hello(), opening(BASIC)], 4096);
        assert_eq!(why, Some(Refusal::Policy));
    }

    #[test]
    fn nothing_follows_a_hello_or_an_opening_before_the_answer() {
        let mut screen = screen(Security::SignAndEncrypt);
        let all = [hello(), opening(BASIC), request("MSGF", 461), request("MSGF", 467)].concat();
        let (mut rest, mut stops) = (&all[..], Vec::new());
        while !rest.is_empty() {
            let mut now = Vec::new();
            let (used, then) = screen.pass(rest, &mut now).unwrap();
            assert_eq!(now, &rest[..used]);
            stops.push((used, then));
            rest = &rest[used..];
        }
        let requests = 2 * request("MSGF", 461).len();
        let (hello, opening) = (hello().len(), opening(BASIC).len());
        assert_eq!(stops, [(hello, Then::Wait), (opening, Then::Open), (requests, Then::GoOn)]);
    }

    #[test]
    fn a_refusal_is_a_message_with_its_size_and_its_reason() {
        let untrusted = Refusal::Untrusted(OWN.to_vec());
        for refusal in [Refusal::NoMessage, Refusal::TooLarge, Refusal::Policy, untrusted, Refusal::Plain] {
            let message = refusal.message();
            assert_eq!(number(&message, SIZE_AT), Some(message.len()));
            assert_eq!(number(&message, LENGTH_AT), Some(message.len() - 16));
        }
    }

    proptest! {
        #[test]
        fn pieces_of_any_length_are_judged_alike(
            piece in 1_usize..200,
            bytes in any::<Vec<u8>>(),
            policy in 0_usize..3,
        ) {
            let opening = opening([BASIC, SHA1, NONE][policy]);
            let messages = [hello(), opening, request("MSGF", 428), bytes];
            let whole = passed(Security::Sign, &messages, 4096);
            prop_assert_eq!(passed(Security::Sign, &messages, piece), whole);
        }
    }
}
