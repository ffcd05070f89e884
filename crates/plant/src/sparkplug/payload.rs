//! What is in a message of Sparkplug B, as Protocol Buffers: the fields that isotherm writes and reads, by their numbers in the
//! specification. Fields with other numbers are skipped.

use std::fmt;

use prost::Message;

/// A message's content.
#[derive(Clone, PartialEq, Message)]
pub struct Payload {
    /// When it was sent, ms since 1970.
    #[prost(uint64, optional, tag = "1")]
    pub timestamp: Option<u64>,
    /// What it tells.
    #[prost(message, repeated, tag = "2")]
    pub metrics: Vec<Metric>,
    /// Its place among the messages since the birth, 0 to 255 and from 0 again. A death and a command have none.
    #[prost(uint64, optional, tag = "3")]
    pub seq: Option<u64>,
}

/// A value with its name or its alias.
#[derive(Clone, PartialEq, Message)]
pub struct Metric {
    /// Its name. In data the alias stands for it.
    #[prost(string, optional, tag = "1")]
    pub name: Option<String>,
    /// A number that the birth gives to the name.
    #[prost(uint64, optional, tag = "2")]
    pub alias: Option<u64>,
    /// When the value was taken, ms since 1970.
    #[prost(uint64, optional, tag = "3")]
    pub timestamp: Option<u64>,
    /// A number of [`DataType`](super::DataType). Data leave it out.
    #[prost(uint32, optional, tag = "4")]
    pub datatype: Option<u32>,
    /// It is not the value of now.
    #[prost(bool, optional, tag = "5")]
    pub is_historical: Option<bool>,
    /// There is no value.
    #[prost(bool, optional, tag = "7")]
    pub is_null: Option<bool>,
    /// What else there is to say of it.
    #[prost(message, optional, tag = "9")]
    pub properties: Option<PropertySet>,
    /// The value.
    #[prost(oneof = "Raw", tags = "10, 11, 12, 13, 14, 15, 16")]
    pub value: Option<Raw>,
}

/// A value as it travels: its data type says what it means.
#[derive(Clone, PartialEq, prost::Oneof)]
pub enum Raw {
    /// Integers of up to 32 bits; negative ones in two's complement.
    #[prost(uint32, tag = "10")]
    Int(u32),
    /// Integers of 64 bits and dates.
    #[prost(uint64, tag = "11")]
    Long(u64),
    /// A real number of 32 bits.
    #[prost(float, tag = "12")]
    Float(f32),
    /// A real number of 64 bits.
    #[prost(double, tag = "13")]
    Double(f64),
    /// Yes or no.
    #[prost(bool, tag = "14")]
    Boolean(bool),
    /// Text.
    #[prost(string, tag = "15")]
    String(String),
    /// Bytes and arrays, none of which is read here.
    #[prost(bytes = "vec", tag = "16")]
    Bytes(Vec<u8>),
}

/// Properties: as many names as values.
#[derive(Clone, PartialEq, Message)]
pub struct PropertySet {
    /// Their names.
    #[prost(string, repeated, tag = "1")]
    pub keys: Vec<String>,
    /// Their values.
    #[prost(message, repeated, tag = "2")]
    pub values: Vec<Property>,
}

/// The value of a property.
#[derive(Clone, PartialEq, Message)]
pub struct Property {
    /// A number of [`DataType`](super::DataType).
    #[prost(uint32, optional, tag = "1")]
    pub datatype: Option<u32>,
    /// There is no value.
    #[prost(bool, optional, tag = "2")]
    pub is_null: Option<bool>,
    /// The value.
    #[prost(oneof = "PropertyRaw", tags = "3, 4, 5, 6, 7, 8")]
    pub value: Option<PropertyRaw>,
}

/// The value of a property as it travels.
#[derive(Clone, PartialEq, prost::Oneof)]
pub enum PropertyRaw {
    /// Integers of up to 32 bits; negative ones in two's complement.
    #[prost(uint32, tag = "3")]
    Int(u32),
    /// Integers of 64 bits and dates.
    #[prost(uint64, tag = "4")]
    Long(u64),
    /// A real number of 32 bits.
    #[prost(float, tag = "5")]
    Float(f32),
    /// A real number of 64 bits.
    #[prost(double, tag = "6")]
    Double(f64),
    /// Yes or no.
    #[prost(bool, tag = "7")]
    Boolean(bool),
    /// Text.
    #[prost(string, tag = "8")]
    String(String),
}

/// Why bytes from a broker are no message of Sparkplug B.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Unreadable {
    /// They are more than may arrive.
    TooLong(usize),
    /// They tell more values than may arrive.
    TooMany(usize),
    /// They are no Protocol Buffers of this form.
    Malformed(String),
}

impl fmt::Display for Unreadable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Unreadable::TooLong(bytes) => {
                write!(f, "{bytes} bytes; more than {} are not read", Payload::MOST_BYTES)
            }
            Unreadable::TooMany(metrics) => {
                write!(f, "{metrics} metrics; more than {} are not read", Payload::MOST_METRICS)
            }
            Unreadable::Malformed(why) => write!(f, "not a message of Sparkplug B ({why})"),
        }
    }
}

impl Payload {
    /// Longer messages are not read. What arrives is a command: some fifty bytes.
    pub const MOST_BYTES: usize = 16 * 1024;

    /// A message of more metrics is not read.
    pub const MOST_METRICS: usize = 64;

    /// Reads what has arrived, from whomever. What it takes of memory is bounded by [`MOST_BYTES`](Payload::MOST_BYTES).
    ///
    /// # Errors
    /// It is too long, tells too much, or is something else.
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

    /// The bytes that are sent.
    pub fn bytes(&self) -> Vec<u8> {
        self.encode_to_vec()
    }
}
