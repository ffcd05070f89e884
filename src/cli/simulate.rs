//! `isotherm virtual`: serves the devices of a profile as virtual hardware.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context;

use super::loading::{ProfileArguments, load, of_other_kind};
use super::signals::Signals;
use crate::cli::print::say;
use crate::clock::Clock;
use crate::discovery::bus::{LineAddress, VirtualLine};
use crate::fieldbus::explain::system;
use crate::virtual_machine::{FaultScript, PlantSpec, Setup, VirtualMachine, VirtualMachineError};
use isotherm_profile::{Bus, Device, FileKind, Profile, Security, safe_file};

/// Serves the devices of a profile as virtual hardware. These are Modbus and OPC UA servers at the addresses of the
/// profile, devices on its serial ports, and nodes on its CAN interfaces.
///
/// A serial port is a pseudo-terminal at the path in the profile. If that path exists already or cannot be created, the
/// port gets another path, which is printed. A CAN interface must exist: `ip link add dev vcan0 type vcan && ip link
/// set vcan0 up`.
///
/// Values come from the plant (simulated machine) in the same directory as the profile (`<name>.plant.toml`), or from
/// that of the shipped machine with this name. Without a plant, the values vary in a plausible way.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm virtual surface-grinder         in one terminal\n  isotherm run \
                  surface-grinder             in another\n  isotherm virtual my-machine.toml --faults faults.toml"
)]
pub(super) struct Arguments {
    #[command(flatten)]
    profile: ProfileArguments,
    /// TOML file with faults of the devices and the times of these faults
    #[arg(long, value_name = "FILE")]
    faults: Option<PathBuf>,
    /// Seed of the simulated day: duty cycle, ambient temperature and noise depend on it
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Time since the start of the simulated day; the shipped machines are switched on a few minutes after that start
    #[arg(long, default_value = "10min", value_name = "SPAN", value_parser = humantime::parse_duration)]
    from: Duration,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let profile = load(&arguments.profile, false)?;
    let faults = match &arguments.faults {
        Some(path) => {
            let text = safe_file::read_text(path)
                .with_context(|| format!("the fault script {} cannot be read", path.display()))?;
            FaultScript::parse(&text, &profile).map_err(|error| {
                let why = anyhow::anyhow!("{}: {error}", path.display());
                of_other_kind(path, FileKind::FaultScript, why)
            })?
        }
        None => FaultScript::default(),
    };
    let plant = plant(&arguments.profile.path, &profile)?;
    let with =
        if plant.is_some() { "its plant" } else { "varying values (no plant file next to the profile)" };
    let setup = Setup { plant, seed: arguments.seed, faults, lived: arguments.from, ..Setup::default() };
    super::runtime::start()?.block_on(async {
        let mut signals = Signals::listen()?;
        let mut machine = VirtualMachine::start(&profile, setup, &Clock::wall()).await.map_err(explained)?;
        say!("{} with {with}, seed {}", profile.name, arguments.seed)?;
        for (bus, address) in machine.addresses() {
            let devices = profile.devices.iter().filter(|device| device.bus == *bus);
            let bus = profile.bus(*bus);
            let devices: Vec<String> = devices.map(|device| named(bus, device)).collect();
            let name = &bus.name;
            let line = LineAddress::of(bus);
            if let VirtualLine::Served(is) = line.kind().virtual_line {
                say!("bus {name} {is} {address}: {}", devices.join(", "))?;
            }
            if line.serial().is_some() && *address != bus.address {
                say!("  the gateway finds it with --set bus.{name}.port={address}")?;
            }
            if bus.opcua.as_ref().is_some_and(|line| line.security != Security::None) {
                say!(
                    "  without security: for the gateway, write security = \"none\" in a copy of the profile, and \
                     remove cert, key and trusted"
                )?;
            }
        }
        for bus in profile.buses.iter() {
            if let VirtualLine::Absent(why) = LineAddress::of(bus).kind().virtual_line {
                say!("{}", why(bus))?;
            }
        }
        say!("stop with Ctrl-C")?;
        tokio::select! {
            () = signals.next() => {}
            error = machine.failure() => return Err(error.into()),
        }
        machine.stop().await?;
        Ok(())
    })
}

/// Returns the error message for a virtual machine that does not start. If a virtual device cannot listen at
/// its address, the message also contains cause and remedy.
fn explained(error: VirtualMachineError) -> anyhow::Error {
    if let VirtualMachineError::Listen { source, .. } = &error {
        return anyhow::anyhow!("{error}: {}", system(source));
    }
    error.into()
}

/// Returns the name of a device for display, and its address if it has one on its bus.
fn named(bus: &Bus, device: &Device) -> String {
    let address = match &device.can {
        None if bus.opcua.is_some() => return device.name.clone(),
        None => format!("unit {}", device.unit),
        Some(can) => can.node.map_or("frames".to_owned(), |node| format!("node {node}")),
    };
    format!("{} ({address})", device.name)
}

/// Returns the plant in the file next to the profile, or that of the shipped machine with this name. Returns `None` if
/// there is no such file and no such shipped machine.
fn plant(path: &Path, profile: &Profile) -> anyhow::Result<Option<PlantSpec>> {
    let beside = path.with_extension("plant.toml");
    if beside.exists() {
        let text = safe_file::read_text(&beside)
            .with_context(|| format!("the plant {} cannot be read", beside.display()))?;
        let home = beside.parent().unwrap_or(Path::new(""));
        let plant = PlantSpec::parse_with(&text, &|name| safe_file::read_text(&home.join(name)).ok())
            .map_err(|error| {
                let why = anyhow::anyhow!("{}: {error}", beside.display());
                of_other_kind(&beside, FileKind::Plant, why)
            })?;
        return Ok(Some(plant));
    }
    Ok(PlantSpec::shipped(&profile.name).transpose()?)
}

#[cfg(test)]
mod tests {
    use std::io::{Error, ErrorKind};

    use super::*;

    #[test]
    fn a_taken_address_has_cause_and_remedy() {
        let source = Error::from(ErrorKind::AddrInUse);
        let (bus, address) = ("cell".to_owned(), "127.0.0.1:1502".to_owned());
        let error = explained(VirtualMachineError::Listen { bus, address, source }).to_string();
        let expected = "cannot listen at 127.0.0.1:1502 (bus `cell`): another program has this port";
        assert!(error.starts_with(expected) && error.contains("end that program"), "{error}");
    }
}
