//! Nodes of an OPC UA server: how a profile names them, and what they hold ↔ registers.
//!
//! The notation is that of OPC UA, Part 6, 5.3.1.10 and 5.3.1.11: `ns=2;s=/Nck/State`, `ns=3;i=1005`, `i=2258`,
//! `nsu=http://plc.example/data;s=/Nck/State`.

use std::fmt;
use std::str::FromStr;

use super::{DataType, Encoded};
use crate::reading::Reason;

/// Which node of a server. Prints as a profile has it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeId {
    /// Namespace.
    pub namespace: Namespace,
    /// Which node in there.
    pub identifier: Identifier,
}

/// Namespace of a node.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Namespace {
    /// `ns=`: its index in the array of the server, which may change when the server restarts. 0 is OPC UA's own.
    Index(u16),
    /// `nsu=`: its URI. Each connection asks the server for the index.
    Uri(String),
}

impl Namespace {
    /// URI of the namespace that has the index 0 at every server.
    const OF_OPC_UA: &str = "http://opcfoundation.org/UA/";

    /// Reads the namespace at the beginning of a node. Returns it with the rest of the text.
    fn parse(text: &str) -> Result<(Namespace, &str), String> {
        let (by_uri, by_index) = (text.strip_prefix("nsu="), text.strip_prefix("ns="));
        let Some(rest) = by_uri.or(by_index) else { return Ok((Namespace::Index(0), text)) };
        let ends = || format!("`{text}` has no `;` and no name after its namespace");
        let (name, rest) = rest.split_once(';').ok_or_else(ends)?;
        if by_index.is_some() {
            let wrong = |_| format!("the namespace of `{text}` is no number up to 65535");
            return Ok((Namespace::Index(name.parse().map_err(wrong)?), rest));
        }
        match unescaped(name)
            .ok_or_else(|| format!("`%` in the URI of `{text}` is written %25, `;` is written %3B"))?
        {
            uri if uri.is_empty() => Err(format!("`{text}` has no URI behind `nsu=`")),
            uri if uri == Namespace::OF_OPC_UA => Ok((Namespace::Index(0), rest)),
            uri => Ok((Namespace::Uri(uri), rest)),
        }
    }
}

/// A URI without the escapes of the notation. `None` if there is another one.
fn unescaped(text: &str) -> Option<String> {
    let mut parts = text.split('%');
    let mut uri = parts.next()?.to_owned();
    for part in parts {
        let (code, rest) = part.split_at_checked(2)?;
        uri.push(match code {
            "25" => '%',
            "3B" | "3b" => ';',
            _ => return None,
        });
        uri += rest;
    }
    Some(uri)
}

/// What tells a node from the others in its namespace.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Identifier {
    /// `i=`
    Number(u32),
    /// `s=`
    Text(String),
    /// `g=`, five groups of hexadecimal digits, in small letters.
    Guid(String),
    /// `b=`, in Base64, of which each node has one form alone.
    Opaque(String),
}

/// One node and what its value is taken for.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Node {
    /// Which.
    pub id: NodeId,
    /// Its own type; `None`: whatever number it has, taken as `f64`.
    pub data_type: Option<DataType>,
}

/// A number as a server sends it: its type, and its bits as [`DataType::encode`] takes them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scalar {
    /// Its type.
    pub data_type: DataType,
    /// Its bits.
    pub bits: u64,
}

impl Node {
    /// How its value lies in the registers that [`Node::registers`] gives.
    pub fn taken_as(&self) -> DataType {
        self.data_type.unwrap_or(DataType::F64)
    }

    /// What the server has sent, as registers with the most significant first.
    ///
    /// # Errors
    /// The node has another type than the profile says.
    pub fn registers(&self, found: Scalar) -> Result<Encoded, Reason> {
        match self.data_type {
            None => Ok(DataType::F64.encode(found.value().to_bits())),
            Some(data_type) if data_type == found.data_type => Ok(data_type.encode(found.bits)),
            Some(_) => Err(Reason::WrongType),
        }
    }

    /// A whole number that its type holds, as such registers.
    pub fn word(&self, number: u16) -> Encoded {
        self.taken_as().encode(u64::from(number))
    }

    /// The number that such registers are, in the node's own type.
    pub fn scalar(&self, registers: &[u16]) -> Scalar {
        Scalar { data_type: self.taken_as(), bits: Encoded::of(registers).bits() }
    }
}

impl Scalar {
    /// The number itself. One of 64 bits beyond 2^53 loses its last digits.
    #[allow(clippy::cast_precision_loss)]
    fn value(self) -> f64 {
        match self.data_type {
            DataType::F32 | DataType::F64 => super::float_of(self.data_type, self.bits),
            _ => super::data_type::integer_of(self.data_type, self.bits) as f64,
        }
    }
}

impl FromStr for NodeId {
    type Err = String;

    /// # Errors
    /// A sentence that says what is wrong.
    fn from_str(text: &str) -> Result<NodeId, String> {
        let (namespace, rest) = Namespace::parse(text)?;
        let (kind, name) = rest
            .split_once('=')
            .ok_or_else(|| format!("`{text}` is no node: one is written `ns=2;s=name` or `i=2258`"))?;
        let identifier = match kind {
            "i" => Identifier::Number(name.parse().map_err(|_| format!("`{name}` is no number of 32 bits"))?),
            "s" if name.is_empty() => return Err(format!("`{text}` has no name behind `s=`")),
            "s" => Identifier::Text(name.to_owned()),
            "g" if is_guid(name) => Identifier::Guid(name.to_ascii_lowercase()),
            "g" => return Err(format!("`{name}` is no GUID")),
            "b" if !is_base64(name) => return Err(format!("`{name}` is no Base64")),
            "b" if !ends_in_whole_bytes(name) => {
                return Err(format!("`{name}` is no Base64: bits of its last digit belong to no byte"));
            }
            "b" => Identifier::Opaque(name.to_owned()),
            _ => return Err(format!("`{kind}=` is no kind of node; allowed: i, s, g, b")),
        };
        Ok(NodeId { namespace, identifier })
    }
}

fn is_guid(text: &str) -> bool {
    let groups: Vec<&str> = text.split('-').collect();
    let is_hex = |(group, len): (&&str, usize)| {
        group.len() == len && group.bytes().all(|byte| byte.is_ascii_hexdigit())
    };
    groups.len() == 5 && groups.iter().zip([8, 4, 4, 4, 12]).all(is_hex)
}

fn is_base64(text: &str) -> bool {
    let digits = text.trim_end_matches('=');
    let is_digit = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'+' | b'/');
    !digits.is_empty()
        && text.len().is_multiple_of(4)
        && text.len() - digits.len() <= 2
        && digits.bytes().all(is_digit)
}

/// What is filled up behind the last byte is zero, as in the one form that a server sends.
fn ends_in_whole_bytes(base64: &str) -> bool {
    const DIGITS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let digits = base64.trim_end_matches('=');
    let last = digits.bytes().last().and_then(|last| DIGITS.iter().position(|digit| *digit == last));
    let beyond = [0, 3, 15].get(base64.len() - digits.len());
    last.zip(beyond).is_some_and(|(last, beyond)| last & beyond == 0)
}

impl fmt::Display for Namespace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Namespace::Index(index) => write!(f, "ns={index}"),
            Namespace::Uri(uri) => write!(f, "nsu={}", uri.replace('%', "%25").replace(';', "%3B")),
        }
    }
}

impl fmt::Display for NodeId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.namespace != Namespace::Index(0) {
            write!(f, "{};", self.namespace)?;
        }
        match &self.identifier {
            Identifier::Number(number) => write!(f, "i={number}"),
            Identifier::Text(text) => write!(f, "s={text}"),
            Identifier::Guid(text) => write!(f, "g={text}"),
            Identifier::Opaque(text) => write!(f, "b={text}"),
        }
    }
}

impl fmt::Display for Node {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.id.fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(text: &str, data_type: Option<DataType>) -> Node {
        Node { id: text.parse().unwrap(), data_type }
    }

    #[test]
    fn a_node_is_read_and_printed_as_the_specification_writes_it() {
        for text in [
            "i=2258",
            "ns=2;s=/Channel/Parameter/R[u1,10]",
            "ns=2;s=a;b=c",
            "ns=3;i=4294967295",
            "ns=1;g=09087e75-8e5e-499b-954f-f2a9603db28a",
            "ns=1;b=M/RbKBsRVkePCePcx24oRA==",
            "nsu=http://plc.example/data;s=offset;z",
            "nsu=urn:a%3Bb%25c;i=7",
        ] {
            assert_eq!(text.parse::<NodeId>().unwrap().to_string(), text);
        }
        for zero in ["ns=0;i=7", "nsu=http://opcfoundation.org/UA/;i=7"] {
            assert_eq!(zero.parse::<NodeId>().unwrap().to_string(), "i=7");
        }
        let uri = "nsu=urn:a%3Bb%25c;i=7".parse::<NodeId>().unwrap().namespace;
        assert_eq!(uri, Namespace::Uri("urn:a;b%c".to_owned()));
        for (text, word) in [
            ("holding:104", "is no node"),
            ("ns=2", "no name after its namespace"),
            ("ns=65536;i=1", "no number up to 65535"),
            ("ns=2;s=", "no name"),
            ("i=-1", "no number of 32 bits"),
            ("i=4294967296", "no number of 32 bits"),
            ("ns=2;x=1", "allowed: i, s, g, b"),
            ("g=09087e75", "no GUID"),
            ("b=M/R", "no Base64"),
            ("b=QR==", "bits of its last digit"),
            ("b=QUF=", "bits of its last digit"),
            ("nsu=urn:plc", "no name after its namespace"),
            ("nsu=;s=offset", "no URI behind `nsu=`"),
            ("nsu=urn:50%;s=offset", "is written %25"),
            ("nsu=urn:a%20b;s=offset", "is written %25"),
        ] {
            let why = text.parse::<NodeId>().unwrap_err();
            assert!(why.contains(word), "{text}: {why}");
        }
    }

    #[test]
    fn one_node_is_one_name_however_its_guid_is_written() {
        let node = |text: &str| text.parse::<NodeId>().unwrap();
        let small = node("ns=1;g=09087e75-8e5e-499b-954f-f2a9603db28a");
        assert_eq!(node("ns=1;g=09087E75-8E5E-499B-954F-F2A9603DB28A"), small);
        assert_eq!(node("b=QQ==").to_string(), "b=QQ==");
        assert_eq!(node("b=QUE=").to_string(), "b=QUE=");
    }

    #[test]
    fn a_node_without_a_type_takes_any_number_as_a_floating_point_one() {
        let any = node("i=1", None);
        let value = |data_type, bits| {
            let bits = any.registers(Scalar { data_type, bits }).unwrap().bits();
            f64::from_bits(bits)
        };
        assert_eq!(any.taken_as(), DataType::F64);
        let close = |found: f64, expected: f64| assert!((found - expected).abs() == 0.0, "{found}");
        close(value(DataType::I16, 0xfff6), -10.0);
        close(value(DataType::signed(8), 0xff), -1.0);
        close(value(DataType::Bool, 1), 1.0);
        close(value(DataType::U64, 1 << 52), 4_503_599_627_370_496.0);
        close(value(DataType::F32, u64::from(27.5f32.to_bits())), 27.5);
        close(value(DataType::F64, (-0.25f64).to_bits()), -0.25);
    }

    #[test]
    fn a_node_with_a_type_takes_that_type_and_no_other() {
        let node = node("ns=2;i=5", Some(DataType::I32));
        let found = Scalar { data_type: DataType::I32, bits: 0xffff_fffe };
        let registers = node.registers(found).unwrap();
        assert_eq!(registers.registers(), [0xffff, 0xfffe]);
        assert_eq!(node.scalar(registers.registers()), found);
        for other in [DataType::U32, DataType::I16, DataType::F32, DataType::Bool] {
            assert_eq!(node.registers(Scalar { data_type: other, bits: 1 }), Err(Reason::WrongType));
        }
    }
}
