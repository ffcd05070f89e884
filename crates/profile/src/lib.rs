//! Machine profile: one TOML file, checked and converted to Rust types before the gateway opens a connection.
//!
//! [`load`] reads the layers: the profile, the `.local.toml` file next to it, the environment, and `--set`.
//! It reports all errors at once, each with its position. The result is a [`Profile`]. References to tables
//! by name have become indices, and the words of the profile have become Rust enums.
//!
//! # Layout
//! - `load`, `merge`, `schema_check`, `source_map`: reading the layers, merging them, checking them against
//!   the schema, and storing the position of each key.
//! - `syntax_errors`: the syntax errors of a TOML file, without errors that only result from others.
//! - [`edit`]: replaces a model in the text of a profile, and keeps the comments.
//! - `overridden_keys`, `protected_keys`: keys that the layers change, and keys that they must not change.
//! - `file_kind`: recognises the kind of a file by its content, to report a file of the wrong kind.
//! - `files`, `sources`: files that a profile names, and the record of everything that was read.
//! - [`host_and_port`], `ip_network`: addresses. [`safe_file`]: files named by a user. `control_chars`: safe
//!   display of texts from untrusted sources.
//! - `template`, `dbc`: device templates, and DBC files, which describe CAN frames.
//! - `key_context`: a key that is being checked, with its errors and warnings.
//! - `kinds`: one folder or file for each kind of bus: its keys, addresses, read requests and preview.
//! - `ids`, `members`, `profile`: indices of tables, the members of devices and buses, and the resolved [`Profile`].
//! - `tables`: one file for each table of the profile: its keys, checks, resolved form, and preview.
//! - [`log_columns`]: names of the columns of a log. No signal may have such a name.
//! - `written_places`: the registers, nodes, objects and frames that the gateway writes.
//! - [`plan`]: the read requests of a device. [`preview`]: the output of `isotherm check`.

mod control_chars;
mod dbc;
mod digest;
mod document;
mod duration;
pub mod edit;
mod error;
mod file_kind;
mod files;
mod host_port;
mod ids;
mod ip_network;
mod key_context;
mod kinds;
mod load;
pub mod log_columns;
mod members;
mod merge;
mod overridden_keys;
pub mod plan;
pub mod preview;
mod profile;
mod protected_keys;
pub mod safe_file;
mod schema_check;
mod schema_of;
mod schemas;
mod size;
mod source_map;
mod sources;
pub mod stop;
mod syntax_errors;
mod tables;
pub mod template;
mod wording;
mod written_places;

pub use control_chars::{lines, one_line};
pub use digest::{sha256, sha256_of};
pub use error::{Errors, ProfileError, allowed, nearest, nearest_or_longer};
pub use file_kind::{FileKind, Misplaced};
pub use host_port::{NoPlace, host_and_port};
pub use ids::{AxisId, BusId, DeviceId, OutputId, SetId};
pub use ip_network::IpNetwork;
pub use kinds::can::emergency::Emergency;
pub use kinds::can::node::{CanDevice, Setup};
pub use kinds::modbus::functions::{Functions, WriteFunction};
pub use kinds::modbus::quirks::{Gateway, Quirks};
pub use kinds::modbus::serial::{Parity, Serial};
pub use kinds::opcua::connection::{OpcUa, Security, User, server_url};
pub use kinds::opcua::nodes::{ReadBy, SourceTime};
pub use load::{
    Loaded, environment, load, load_and_keep, load_before_certificates, load_edited, load_from, parse,
    parse_beside, parse_with,
};
pub use members::{Members, ProfileMembers};
pub use overridden_keys::Overridden;
pub use profile::Profile;
pub use schemas::schema;
pub use sources::{FileStamp, SOURCES_MARK, Sources};
pub use tables::axis::learning::{LEARNED, Learning};
pub use tables::axis::model::network;
pub use tables::axis::probe::ProbeInput;
pub use tables::axis::{Axis, Purpose};
pub use tables::bus::tls::{NamedFile, TLS_PORT, Tls};
pub use tables::bus::transport::Transport;
pub use tables::bus::{Bus, Sync};
pub use tables::device::Device;
pub use tables::device::verify::Expected;
pub use tables::handshake::{Bit, Handshake};
pub use tables::heartbeat::Heartbeat;
pub use tables::history::History;
pub use tables::label::labelled;
pub use tables::machine::{Arm, OnStop};
pub use tables::mqtt::broker::BrokerUrl;
pub use tables::mqtt::{Mqtt, MqttFormat, MqttUser};
pub use tables::notify::body::{BodyTemplate, MessageField};
pub use tables::notify::url::Url;
pub use tables::notify::{ALARM, ALARM_OVER, AXIS_OFF, CLOCK, Notify, TRIGGERS, UNVERIFIED};
pub use tables::opcua_server::user::{ServerLogin, ServerUser};
pub use tables::opcua_server::{AnonymousClients, OpcUaServer};
pub use tables::output::applied::Applied;
pub use tables::output::display::{Display, ExtraWord, Shown, Stale};
pub use tables::output::share::Share;
pub use tables::output::verify::Verify;
pub use tables::output::writes::Writes;
pub use tables::output::{Output, Stated};
pub use tables::register::{Bits, Cell, Flag};
pub use tables::set::{OutputSet, OwnWord, Stretch};
pub use tables::signal::Signal;
pub use tables::signal::counter::Capture;
pub use tables::signal::limits::{DefaultLimits, DefaultRange};
pub use tables::signal::unit::Unit;
pub use tables::web::{Commands, Language, PLAIN, Web, WebTls};
pub use template::Template;
pub use wording::{NO_MACHINE_START, counted, duration_text};
