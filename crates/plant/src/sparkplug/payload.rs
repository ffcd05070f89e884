//! Content of a message of Sparkplug B, as Protocol Buffers. The fields that isotherm writes and reads have their
//! numbers in the specification. Fields with other numbers are skipped.

use std::fmt;

use prost::Message;

/// Content of a Sparkplug B message.
#[derive(Clone, PartialEq, Message)]
pub struct Payload {
    /// Time of sending, ms since 1970.
    #[prost(uint64, optional, tag = "1")]
    pub timestamp: Option<u64>,
    /// Metrics of the message.
    #[prost(message, repeated, tag = "2")]
    pub metrics: Vec<Metric>,
    /// Sequence number since the birth: 0 to 255, then again from 0. Deaths and commands have no sequence number.
    #[prost(uint64, optional, tag = "3")]
    pub seq: Option<u64>,
}

/// Metric of a message: a value with its name or its alias.
#[derive(Clone, PartialEq, Message)]
pub struct Metric {
    /// Name of the metric. Data messages contain the alias instead.
    #[prost(string, optional, tag = "1")]
    pub name: Option<String>,
    /// Number that the birth assigns to the name.
    #[prost(uint64, optional, tag = "2")]
    pub alias: Option<u64>,
    /// Time of the value, ms since 1970.
    #[prost(uint64, optional, tag = "3")]
    pub timestamp: Option<u64>,
    /// Number of the [`DataType`](super::DataType). Data messages do not contain it.
    #[prost(uint32, optional, tag = "4")]
    pub datatype: Option<u32>,
    /// Whether the value is historical: measured in the past and published late.
    #[prost(bool, optional, tag = "5")]
    pub is_historical: Option<bool>,
    /// Whether the metric has no value.
    #[prost(bool, optional, tag = "7")]
    pub is_null: Option<bool>,
    /// Properties of the metric, for example its quality.
    #[prost(message, optional, tag = "9")]
    pub properties: Option<PropertySet>,
    /// Encoded value; `None` if there is no value.
    #[prost(oneof = "Raw", tags = "10, 11, 12, 13, 14, 15, 16")]
    pub value: Option<Raw>,
}

/// Encoded value; the data type defines its meaning.
#[derive(Clone, PartialEq, prost::Oneof)]
pub enum Raw {
    /// Integers of up to 32 bits; negative ones in two's complement.
    #[prost(uint32, tag = "10")]
    Int(u32),
    /// Integers of 64 bits and dates.
    #[prost(uint64, tag = "11")]
    Long(u64),
    /// Real number, 32 bits.
    #[prost(float, tag = "12")]
    Float(f32),
    /// Real number, 64 bits.
    #[prost(double, tag = "13")]
    Double(f64),
    /// Boolean.
    #[prost(bool, tag = "14")]
    Boolean(bool),
    /// Text.
    #[prost(string, tag = "15")]
    String(String),
    /// Bytes and arrays, which are not supported.
    #[prost(bytes = "vec", tag = "16")]
    Bytes(Vec<u8>),
}

/// Properties of a metric. The two lists have the same length.
#[derive(Clone, PartialEq, Message)]
pub struct PropertySet {
    /// Names of the properties.
    #[prost(string, repeated, tag = "1")]
    pub keys: Vec<String>,
    /// Values of the properties, in the order of the names.
    #[prost(message, repeated, tag = "2")]
    pub values: Vec<Property>,
}

/// Value of a property, with its data type.
#[derive(Clone, PartialEq, Message)]
pub struct Property {
    /// Number of a [`DataType`](super::DataType).
    #[prost(uint32, optional, tag = "1")]
    pub datatype: Option<u32>,
    /// Whether the property has no value.
    #[prost(bool, optional, tag = "2")]
    pub is_null: Option<bool>,
    /// Encoded value; `None` if there is no value.
    #[prost(oneof = "PropertyRaw", tags = "3, 4, 5, 6, 7, 8")]
    pub value: Option<PropertyRaw>,
}

/// Encoded value of a property.
#[derive(Clone, PartialEq, prost::Oneof)]
pub enum PropertyRaw {
    /// Integers of up to 32 bits; negative ones in two's complement.
    #[prost(uint32, tag = "3")]
    Int(u32),
    /// Integers of 64 bits and dates.
    #[prost(uint64, tag = "4")]
    Long(u64),
    /// Real number, 32 bits.
    #[prost(float, tag = "5")]
    Float(f32),
    /// Real number, 64 bits.
    #[prost(double, tag = "6")]
    Double(f64),
    /// Boolean.
    #[prost(bool, tag = "7")]
    Boolean(bool),
    /// Text.
    #[prost(string, tag = "8")]
    String(String),
}

/// Reason why received bytes are rejected as a message of Sparkplug B.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Unreadable {
    /// The message is longer than the limit; contains its number of bytes.
    TooLong(usize),
    /// The message has more metrics than the limit; contains their number.
    TooMany(usize),
    /// The bytes are not a valid Protocol Buffers message of Sparkplug B; contains the reason.
    Malformed(String),
}

impl fmt::Display for Unreadable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Unreadable::TooLong(bytes) => {
                write!(f, "the message has {bytes} bytes; at most {} are accepted", Payload::MOST_BYTES)
            }
            Unreadable::TooMany(metrics) => {
                write!(f, "the message has {metrics} metrics; at most {} are accepted", Payload::MOST_METRICS)
            }
            Unreadable::Malformed(why) => write!(f, "not a message of Sparkplug B ({why})"),
        }
    }
}

impl Payload {
    /// Maximum length of a received message, in bytes. A normal command has about fifty bytes.
    pub const MOST_BYTES: usize = 16 * 1024;

    /// Maximum number of metrics in a received message.
    pub const MOST_METRICS: usize = 64;

    /// Decodes a message from an untrusted sender. The limit [`MOST_BYTES`](Payload::MOST_BYTES) also bounds the memory
    /// that is used.
    ///
    /// # Errors
    /// The message is too long, contains too many metrics, or is invalid.
    pub fn arrived(bytes: &[u8]) -> Result<Payload, Unreadable> {
        if bytes.len() > Payload::MOST_BYTES {
            return Err(Unreadable::TooLong(bytes.len()));
        }
        let payload = Payload::decode(bytes).map_err(|error| Unreadable::Malformed(error.to_string()))?;
        match payload.metrics.len() {
            metrics if metrics > Payload::MOST_METRICS => Err(Unreadable::TooMany(metrics)),
            _ => Ok(payload),
        }
    }

    /// Encodes the message as Protocol Buffers.
    pub fn bytes(&self) -> Vec<u8> {
        self.encode_to_vec()
    }
}
