//! `isotherm opcua`: creates, shows and trusts the certificates of an OPC UA line.

use std::path::{Path, PathBuf};

use super::loading::{ProfileArguments, reported};
use isotherm_profile::{Bus, Loaded, NamedFile, OpcUa, Profile};

mod own;
mod trust;

/// Creates and shows the gateway's own certificate of an OPC UA line, or shows and trusts the server's certificate.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm opcua certificate my-machine.toml     makes the certificate if there \
                  is none, and shows it\n  isotherm opcua trust my-machine.toml           shows the server's \
                  certificate, and trusts it if you confirm"
)]
pub(super) struct Arguments {
    #[command(subcommand)]
    what: OpcuaVerb,
}

#[derive(Debug, clap::Subcommand)]
enum OpcuaVerb {
    /// Shows the gateway's own certificate; creates certificate and key if both are missing
    Certificate(own::Arguments),
    /// Shows the server's certificate, and trusts it after your confirmation
    Trust(trust::Arguments),
}

/// Selection of an OPC UA line of a profile.
#[derive(clap::Args, Debug)]
struct LineArguments {
    #[command(flatten)]
    profile: ProfileArguments,
    /// Name of the bus; needed if the profile has several OPC UA buses
    #[arg(long, value_name = "BUS")]
    bus: Option<String>,
    /// Prints one JSON document
    #[arg(long)]
    json: bool,
}

/// OPC UA line with security, and the certificate files that its profile names.
struct SecuredLine {
    bus: Bus,
    machine: String,
    cert: NamedFile,
    key: NamedFile,
    trusted: PathBuf,
    beside: PathBuf,
}

/// Certificate and key of the gateway, for a bus line or for its OPC UA server.
struct OwnFiles {
    /// Owner of the certificate, as a part of a message: `bus nck`, or `the OPC UA server`.
    owner: String,
    /// Name of the bus; `None` for the OPC UA server of the gateway.
    bus: Option<String>,
    machine: String,
    cert: NamedFile,
    key: NamedFile,
    beside: PathBuf,
    /// Sentence that says where the certificate must be trusted.
    next: String,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    match &arguments.what {
        OpcuaVerb::Certificate(arguments) => own::run(arguments),
        OpcuaVerb::Trust(arguments) => trust::run(arguments),
    }
}

impl LineArguments {
    /// Loads the profile, whose certificate files need not exist.
    fn load(&self) -> anyhow::Result<Loaded> {
        let ProfileArguments { path, set } = &self.profile;
        let loaded = isotherm_profile::load_before_certificates(path, set, &isotherm_profile::environment());
        reported(loaded, self.json)
    }

    /// Returns certificate and key of the selected line.
    fn own_of_line(&self) -> anyhow::Result<OwnFiles> {
        let SecuredLine { bus, machine, cert, key, beside, .. } = self.find()?;
        let next = format!("The server at {} must trust this certificate", bus.address);
        let owner = format!("bus {}", bus.name);
        Ok(OwnFiles { owner, bus: Some(bus.name), machine, cert, key, beside, next })
    }

    /// Returns certificate and key of the OPC UA server of the profile.
    fn own_of_server(&self) -> anyhow::Result<OwnFiles> {
        let profile = self.load()?.profile;
        let Some(server) = profile.opcua_server else {
            anyhow::bail!("the profile has no [opcua_server]");
        };
        let Some((cert, key)) = server.own else {
            anyhow::bail!(
                "[opcua_server] uses no certificate: write security = \"sign-and-encrypt\", `cert`, `key` and \
                 `trusted`"
            );
        };
        let beside = self.profile.path.parent().unwrap_or(Path::new("")).to_owned();
        let next = "Each client must trust this certificate".to_owned();
        let (owner, machine) = ("the OPC UA server".to_owned(), profile.name);
        Ok(OwnFiles { owner, bus: None, machine, cert, key, beside, next })
    }

    /// Returns the selected line. Its certificate files need not exist.
    fn find(&self) -> anyhow::Result<SecuredLine> {
        let path = &self.profile.path;
        let profile = self.load()?.profile;
        let (bus, line) = self.line(&profile)?;
        let (Some((cert, key)), Some(trusted)) = (&line.own, &line.trusted_in) else {
            anyhow::bail!(
                "bus {} is not secured, and uses no certificate: write security = \"sign-and-encrypt\", \
                 `cert`, `key` and `trusted` if the server supports it (`isotherm scan --bus {}` shows this)",
                bus.name,
                bus.address
            );
        };
        let beside = path.parent().unwrap_or(Path::new("")).to_owned();
        Ok(SecuredLine {
            bus: bus.clone(),
            machine: profile.name.clone(),
            cert: cert.clone(),
            key: key.clone(),
            trusted: beside.join(trusted),
            beside,
        })
    }

    fn line<'p>(&self, profile: &'p Profile) -> anyhow::Result<(&'p Bus, &'p OpcUa)> {
        let lines = profile.buses.iter().filter_map(|bus| Some((bus, bus.opcua.as_deref()?)));
        let lines: Vec<(&Bus, &OpcUa)> = lines.collect();
        let names: Vec<&str> = lines.iter().map(|(bus, _)| bus.name.as_str()).collect();
        match (&self.bus, lines.as_slice()) {
            (_, []) => anyhow::bail!("the profile has no bus of type \"opcua\""),
            (None, [one]) => Ok(*one),
            (None, _) => anyhow::bail!("--bus is missing; the OPC UA buses are: {}", names.join(", ")),
            (Some(name), _) => match names.iter().position(|known| known == name) {
                Some(place) => Ok(lines[place]),
                None => {
                    anyhow::bail!(
                        "`{name}` is not a bus of type \"opcua\"; the OPC UA buses are: {}",
                        names.join(", ")
                    )
                }
            },
        }
    }
}
