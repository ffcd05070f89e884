//! Nodes of an OPC UA server: their notation in a profile, and conversion between their values and registers.
//!
//! The notation is that of OPC UA, Part 6, 5.3.1.10 and 5.3.1.11: `ns=2;s=/Nck/State`, `ns=3;i=1005`, `i=2258`,
//! `nsu=http://plc.example/data;s=/Nck/State`.

use std::fmt;
use std::str::FromStr;

use super::data_type::integer_of;
use super::float::float_of;
use super::{DataType, Element, Encoded};
use crate::reading::Reason;

/// Identifier of a node, with its namespace. Formatted in the notation of the profile.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeId {
    /// Namespace of the node, given by its index or its URI.
    pub namespace: Namespace,
    /// Identifier within the namespace: a number, a text, a GUID or bytes.
    pub identifier: Identifier,
}

/// Namespace of a node.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Namespace {
    /// `ns=`: index in the namespace array of the server. The index may change when the server restarts. Index 0 is the
    /// namespace of OPC UA itself.
    Index(u16),
    /// `nsu=`: URI of the namespace. The gateway asks the server for the index at each connection.
    Uri(String),
}

impl Namespace {
    /// URI of the namespace that has index 0 on every server.
    const OF_OPC_UA: &str = "http://opcfoundation.org/UA/";

    /// Parses the namespace at the beginning of the text of a node. Returns the namespace and the rest of the text, or
    /// a message about the mistake.
    fn parse(text: &str) -> Result<(Namespace, &str), String> {
        let (by_uri, by_index) = (text.strip_prefix("nsu="), text.strip_prefix("ns="));
        let Some(rest) = by_uri.or(by_index) else { return Ok((Namespace::Index(0), text)) };
        let ends = || format!("`{text}` has no `;` and no node after the namespace");
        let (name, rest) = rest.split_once(';').ok_or_else(ends)?;
        if by_index.is_some() {
            let wrong = |_| format!("the namespace of `{text}` is not a number from 0 to 65535");
            return Ok((Namespace::Index(name.parse().map_err(wrong)?), rest));
        }
        match unescaped(name)
            .ok_or_else(|| format!("in the URI of `{text}`, `%` must be written as %25 and `;` as %3B"))?
        {
            uri if uri.is_empty() => Err(format!("`{text}` has no URI after `nsu=`")),
            uri if uri == Namespace::OF_OPC_UA => Ok((Namespace::Index(0), rest)),
            uri => Ok((Namespace::Uri(uri), rest)),
        }
    }
}

/// Decodes the escapes `%25` and `%3B` in a URI. Returns `None` if it contains another escape.
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

/// Identifier of a node within its namespace.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Identifier {
    /// `i=`: number.
    Number(u32),
    /// `s=`: text.
    Text(String),
    /// `g=`: GUID, five groups of hexadecimal digits in lower case.
    Guid(String),
    /// `b=`: bytes in Base64. Only the canonical form is accepted, so each node has one notation.
    Opaque(String),
}

/// Node with the type that its value is expected to have.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Node {
    /// Identifier of the node with its namespace, for example `ns=2;s=/Nck/State`.
    pub id: NodeId,
    /// Type of the value. If `None`, any number is accepted and converted to `f64`, even a text that contains only a
    /// number.
    pub data_type: Option<DataType>,
    /// Element of the node's array. `None` if the node has a single value.
    pub element: Option<Element>,
}

/// Number with its type, as an OPC UA server sends or receives it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scalar {
    /// Type of the number, which determines the meaning of its bits.
    pub data_type: DataType,
    /// Bits of the number, as [`DataType::encode`] expects them.
    pub bits: u64,
}

impl Node {
    /// Creates a node with a single value.
    pub const fn new(id: NodeId, data_type: Option<DataType>) -> Node {
        Node { id, data_type, element: None }
    }

    /// Returns the type with which [`Node::registers`] encodes the value: the type in the profile, or `f64` if the
    /// profile states no type.
    pub fn taken_as(&self) -> DataType {
        self.data_type.unwrap_or(DataType::F64)
    }

    /// Converts a value from the server into registers, most significant register first.
    ///
    /// # Errors
    /// [`Reason::WrongType`] if the type differs from the type in the profile.
    pub fn registers(&self, found: Scalar) -> Result<Encoded, Reason> {
        match self.data_type {
            None => Ok(DataType::F64.encode(found.value().to_bits())),
            Some(data_type) if data_type == found.data_type => Ok(data_type.encode(found.bits)),
            Some(_) => Err(Reason::WrongType),
        }
    }

    /// Encodes an integer as registers of the node's type, which must have room for it.
    pub fn word(&self, number: u16) -> Encoded {
        self.taken_as().encode(u64::from(number))
    }

    /// Converts registers into a number of the node's type.
    pub fn scalar(&self, registers: &[u16]) -> Scalar {
        Scalar { data_type: self.taken_as(), bits: Encoded::of(registers).bits() }
    }
}

impl Scalar {
    /// Returns the number as a float. Integers beyond 2^53 lose their last digits.
    #[allow(clippy::cast_precision_loss)]
    pub fn value(self) -> f64 {
        match self.data_type {
            DataType::F32 | DataType::F64 => float_of(self.data_type, self.bits),
            _ => integer_of(self.data_type, self.bits) as f64,
        }
    }
}

impl FromStr for NodeId {
    type Err = String;

    /// Parses a node in the notation of the profile, for example `ns=2;s=/Nck/State`.
    ///
    /// # Errors
    /// Returns a sentence that describes the mistake.
    fn from_str(text: &str) -> Result<NodeId, String> {
        let (namespace, rest) = Namespace::parse(text)?;
        let (kind, name) = rest
            .split_once('=')
            .ok_or_else(|| format!("`{text}` is not a node: write a node as `ns=2;s=name` or `i=2258`"))?;
        let identifier = match kind {
            "i" => Identifier::Number(
                name.parse().map_err(|_| format!("`{name}` is not a number from 0 to 4294967295"))?,
            ),
            "s" if name.is_empty() => return Err(format!("`{text}` has no name after `s=`")),
            "s" => Identifier::Text(name.to_owned()),
            "g" if is_guid(name) => Identifier::Guid(name.to_ascii_lowercase()),
            "g" => return Err(format!("`{name}` is not a GUID")),
            "b" if !is_base64(name) => return Err(format!("`{name}` is not Base64")),
            "b" if !ends_in_whole_bytes(name) => {
                return Err(format!(
                    "`{name}` is not canonical Base64: the unused bits of its last character must be zero"
                ));
            }
            "b" => Identifier::Opaque(name.to_owned()),
            _ => return Err(format!("`{kind}=` is not a type of node identifier; allowed: i, s, g, b")),
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

/// Returns whether the unused bits of the last Base64 digit are zero, as in the canonical form that a server sends.
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
        Node::new(text.parse().unwrap(), data_type)
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
            ("holding:104", "is not a node"),
            ("ns=2", "no `;` and no node after the namespace"),
            ("ns=65536;i=1", "is not a number from 0 to 65535"),
            ("ns=2;s=", "no name"),
            ("i=-1", "not a number from 0 to 4294967295"),
            ("i=4294967296", "not a number from 0 to 4294967295"),
            ("ns=2;x=1", "allowed: i, s, g, b"),
            ("g=09087e75", "not a GUID"),
            ("b=M/R", "not Base64"),
            ("b=QR==", "not canonical Base64"),
            ("b=QUF=", "not canonical Base64"),
            ("nsu=urn:plc", "no `;` and no node after the namespace"),
            ("nsu=;s=offset", "no URI after `nsu=`"),
            ("nsu=urn:50%;s=offset", "written as %25"),
            ("nsu=urn:a%20b;s=offset", "written as %25"),
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
